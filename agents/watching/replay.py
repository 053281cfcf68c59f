"""A recording of the live system (`python -m activeslam_gym live --record DIR`) as an animation or for Rerun."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from activeslam_gym.live import drawing
from activeslam_gym.live.recording import read_about, read_states
from activeslam_gym.live.state import State
from activeslam_gym.rendering.scene import CAMERA, FIDUCIAL, INITIALISED, MAPPED
from activeslam_gym.vision.film import from_above, view
from agents.recording import TIMELINE, log_ellipsoids, open_stream, rgb
from agents.watching.film import Picture, side_by_side, strip, write_animation

_HALF_TURN = Rotation.from_quat((0.0, 0.0, 1.0, 0.0))
"""From the filter's camera, x left and y up, to an image's, x right and y down."""


def animate(folders: Sequence[Path], path: Path, every: float, speed: float, width: int) -> None:
    """Write the camera's images, with the ellipses and the command, above the map, ``every`` so many seconds, as an
    animation; several recordings side by side.

    Raises:
        OSError, ValueError: there is no recording, it is damaged or empty, or ``path`` cannot be written.
    """
    films, names = [], []
    for folder in folders:
        about, way, pictures, first = read_about(folder), list[np.ndarray](), list[Picture](), None
        for state in read_states(folder):
            first = first or state
            way.append(state.camera[:7])
            if state.time >= every * len(pictures) - 1e-9:
                pictures.append(_picture(state, way, about.room_size if about.person else None, width))
        if first is None:
            raise ValueError(f"{folder} holds no state")
        films.append(pictures)
        names.append({None: folder.name, True: "follows the advice", False: "moves at random"}[first.follows])
    write_animation(path, films[0] if len(films) == 1 else side_by_side(films, names), every / speed)


def _picture(state: State, way: list[np.ndarray], room: tuple[float, float, float] | None, width: int) -> Picture:
    """The command, the view and the map, one below the other."""
    seen = view(state.moment)
    both = Image.fromarray(np.vstack((seen, from_above(state.moment, way, seen.shape, room))))
    command = "" if state.follows is False else f"{drawing.NAMES[state.motion]}   "
    words = f"{state.time:.1f} s   {command}entropy {state.log2_dets[2]:.0f}"
    both = both.resize((width, round(width * both.height / both.width)))
    return np.vstack((strip(words, width), np.asarray(both)))


def log_rerun(folder: Path, path: Path) -> None:
    """Write the recording for the Rerun viewer: map, camera, path, image, command and entropies over time.

    Raises:
        ImportError: rerun-sdk is missing; the message says how to get it.
        OSError, ValueError: there is no recording, or it is damaged.
    """
    about, way = read_about(folder), []
    with ExitStack() as at_close:
        rerun, stream = open_stream(path, about.name, at_close)
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        lens = rerun.Pinhole(focal_length=about.focal, resolution=about.image_size, image_plane_distance=0.2)
        stream.log("world/camera/image", lens, static=True)
        for state in read_states(folder):
            stream.set_time(TIMELINE, duration=state.time)
            position, q_WC = state.camera[:3], Rotation.from_quat(state.camera[3:7], scalar_first=True)
            way.append(position)
            turned = rerun.Quaternion(xyzw=(q_WC * _HALF_TURN).as_quat())
            stream.log("world/camera", rerun.Transform3D(translation=position, quaternion=turned))
            stream.log("world/camera/image", rerun.Image(state.image))
            stream.log("world/way", rerun.LineStrips3D([np.array(way)], colors=rgb(CAMERA)))
            stream.log("world/target", rerun.Points3D(state.fiducials, colors=rgb(FIDUCIAL), radii=[0.02]))
            if len(state.ids):
                colours = [MAPPED if placed else INITIALISED for placed in state.mapped]
                log_ellipsoids(rerun, stream, "world/features", state.points, state.covariances, colours)
            stream.log("command", rerun.TextLog(drawing.NAMES[state.motion]))
            for name, value in zip(("camera", "map", "total"), state.log2_dets):
                if np.isfinite(value):
                    stream.log(f"log2_det/{name}", rerun.Scalars(float(value)))
