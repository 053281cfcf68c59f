"""A recording of the live system (`python -m activeslam_gym live --record DIR`) as an animation or for Rerun."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.live import drawing
from activeslam_gym.live.recording import read_about, read_states
from activeslam_gym.live.state import State
from activeslam_gym.rendering.scene import CAMERA, ELLIPSOID_SIGMAS, FIDUCIAL, INITIALISED, MAPPED, TEXT
from agents.recording import TIMELINE, ellipsoid_axes
from agents.watching.film import STRIP_PX, Picture, write_animation

_HALF_TURN_XYZW = np.array((0.0, 0.0, 1.0, 0.0))
"""From the filter's camera, x left and y up, to an image's, x right and y down."""


def animate(folder: Path, path: Path, every: float, speed: float, width: int) -> None:
    """Write what the camera saw, with the ellipses and the command, ``every`` so many seconds, as an animation.

    Raises:
        OSError, ValueError: there is no recording, it is damaged or empty, or ``path`` cannot be written.
    """
    pictures: list[Picture] = []
    for state in read_states(folder):
        if state.time >= every * len(pictures) - 1e-9:
            pictures.append(_picture(state, width))
    if not pictures:
        raise ValueError(f"{folder} holds no state")
    write_animation(path, pictures, every / speed)


def _picture(state: State, width: int) -> Picture:
    """The view under the command."""
    from PIL import Image, ImageDraw, ImageFont

    view = Image.fromarray(drawing.view(state))
    view = view.resize((width, round(width * view.height / view.width)))
    strip = Image.new("RGB", (width, STRIP_PX), "white")
    words = f"{state.time:.1f} s   {drawing.NAMES[state.motion]}   {len(state.ids)} features"
    ImageDraw.Draw(strip).text((0.022 * width, 6), words, fill=TEXT, font=ImageFont.load_default(16))
    return np.vstack((np.asarray(strip), np.asarray(view)))


def log_rerun(folder: Path, path: Path) -> None:
    """Write the recording for the Rerun viewer: map, camera, way, image, command and entropies over time.

    Raises:
        ImportError: rerun-sdk is missing; the message says how to get it.
        OSError, ValueError: there is no recording, or it is damaged.
    """
    try:
        import rerun
    except ImportError as error:
        raise ImportError("rerun-sdk is needed to record: pip install rerun-sdk") from error
    about = read_about(folder)
    with ExitStack() as at_close:
        stream = rerun.RecordingStream("activeslam_gym", send_properties=True)
        stream.save(at_close.enter_context(written_whole(path)))
        at_close.callback(stream.disconnect)
        at_close.callback(stream.flush)
        stream.send_recording_name(about.name)
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        lens = rerun.Pinhole(focal_length=about.focal, resolution=about.image_size, image_plane_distance=0.2)
        stream.log("world/camera/image", lens, static=True)
        way: list[np.ndarray] = []
        for state in read_states(folder):
            stream.set_time(TIMELINE, duration=state.time)
            way.append(state.camera[:3])
            _log(rerun, stream, state, np.array(way))


def _log(rerun: Any, stream: Any, state: State, way: np.ndarray) -> None:
    """A moment."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_quat(state.camera[3:7], scalar_first=True) * Rotation.from_quat(_HALF_TURN_XYZW)
    pose = rerun.Transform3D(translation=state.camera[:3], quaternion=rerun.Quaternion(xyzw=turned.as_quat()))
    stream.log("world/camera", pose)
    stream.log("world/camera/image", rerun.Image(state.image))
    stream.log("world/way", rerun.LineStrips3D([way], colors=[drawing.rgb(CAMERA)]))
    stream.log("world/target", rerun.Points3D(state.fiducials, colors=[drawing.rgb(FIDUCIAL)], radii=[0.02]))
    if len(state.ids):
        sizes, turns = ellipsoid_axes(state.covariances, ELLIPSOID_SIGMAS)
        colours = [MAPPED if placed else INITIALISED for placed in state.mapped]
        shapes = {"centers": state.points, "half_sizes": sizes, "quaternions": turns}
        stream.log("world/features", rerun.Ellipsoids3D(**shapes, colors=[drawing.rgb(colour) for colour in colours]))
    stream.log("command", rerun.TextLog(drawing.NAMES[state.motion]))
    for name, value in zip(("camera", "map", "total"), state.log2_dets):
        if np.isfinite(value):
            stream.log(f"log2_det/{name}", rerun.Scalars(float(value)))
