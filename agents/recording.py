"""An episode as a Rerun recording (the extra `rerun`): map, both cameras, image, trajectories and curves over time.

Open the file with ``rerun episode.rrd`` and drag the time. Camera and world axes are the environment's own (x left, y
up, z forward), and Rerun is told so; nothing is mirrored. The pinhole leaves the lens's distortion out, so that the
image's points, which are pixels as detected, lie a little inside the pixels of their rays in the map.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym import Scenario
from activeslam_gym.files import written_whole
from activeslam_gym.rendering.geometry import ellipses
from activeslam_gym.rendering.scene import (
    CAMERA,
    ELLIPSOID_SIGMAS,
    EXPECTED,
    FIDUCIAL,
    GATE_SIGMAS,
    MAPPED,
    MUTED,
    TRUTH,
    believed_points,
    command_text,
    predicted_pixels,
)

if TYPE_CHECKING:
    from activeslam_gym.envs.snapshot import Snapshot

TIMELINE = "time"  # seconds since the reset
WHOSE = {"truth": TRUTH, "belief": CAMERA}  # the two cameras, with their colours
_CURVES = ("entropy", "landmarks_mapped", "position_error", "orientation_error", "landmark_rmse", "log_score")
"""Numbers of `info` that become curves of their own."""


def open_stream(path: Path, name: str, at_close: ExitStack, with_views: bool = False) -> tuple[Any, Any]:
    """Rerun, and a stream into the file ``path``, which is there, whole, when ``at_close`` is closed.

    Raises:
        ImportError: rerun-sdk is missing; the message says how to get it.
    """
    try:
        import rerun
    except ImportError as error:
        hint = "pip install rerun-sdk, or in a clone: pip install -e '.[rerun]'"
        raise ImportError(f"rerun-sdk is needed to record: {hint}") from error
    stream = rerun.RecordingStream("activeslam_gym", send_properties=True)
    views = {"default_blueprint": _views()} if with_views else {}
    stream.save(at_close.enter_context(written_whole(path)), **views)
    at_close.callback(stream.disconnect)  # the last to enter is the first to be done
    at_close.callback(stream.flush)
    stream.send_recording_name(name)
    return rerun, stream


def log_ellipsoids(rerun: Any, stream: Any, name: str, means: Any, covariances: np.ndarray, colours: Any) -> None:
    """Ellipsoids of points (n, 3) with covariances (n, 3, 3)."""
    sizes, turns = ellipsoid_axes(covariances, ELLIPSOID_SIGMAS)
    shapes = rerun.Ellipsoids3D(centers=means, half_sizes=sizes, quaternions=turns, colors=rgb(*colours))
    stream.log(name, shapes)


def ellipsoid_axes(covariances: np.ndarray, sigmas: float) -> tuple[np.ndarray, np.ndarray]:
    """Half-lengths (n, 3) [m] and orientations (n, 4), scalar *last*, of the ellipsoids of covariances (n, 3, 3)."""
    eigenvalues, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, not a reflection
    return sigmas * np.sqrt(np.maximum(eigenvalues, 0.0)), Rotation.from_matrix(axes).as_quat()


def rgb(*colours: str) -> np.ndarray:
    """(n, 3) uint8 of names "#rrggbb"."""
    return np.array([list(bytes.fromhex(colour[1:])) for colour in colours], np.uint8).reshape(-1, 3)


class Recording(ExitStack):
    """Writes an environment moment by moment; the file is there, whole, after `close` or the end of the block.

    Args:
        path: The file, ``*.rrd``.
        scenario: The environment's, `env.unwrapped.scenario`.
        name: Title in the viewer.

    Raises:
        ImportError: rerun-sdk is missing; the message says how to get it.
    """

    def __init__(self, path: str | os.PathLike[str], scenario: Scenario, name: str = "active SLAM") -> None:
        super().__init__()
        self._rr, self._stream = open_stream(Path(path), name, self, with_views=True)
        self._log_setting(scenario)
        self._paths: dict[str, list[np.ndarray]] = {"truth": [], "belief": []}
        self._command = ""

    def __exit__(self, *_: Any) -> None:
        super().__exit__(None, None, None)  # an interrupted recording is kept

    def log(self, env: Any, info: dict[str, Any]) -> None:
        """Add the present moment of a single environment; ``info`` is that of its last `reset` or `step`."""
        core = env.unwrapped
        snapshot = core.snapshot()
        if first := not self._paths["truth"]:
            self._log_points("truth/landmarks", snapshot.true_landmarks, TRUTH, 0.02, static=True)
            self._log_points("fiducials", snapshot.fiducials, FIDUCIAL, 0.02, static=True)
        self._stream.set_time(TIMELINE, duration=snapshot.time)
        self._log_camera("truth", snapshot.true_position, snapshot.true_quaternion)
        self._log_camera("belief", snapshot.position, snapshot.quaternion)
        log_ellipsoids(self._rr, self._stream, "world/belief/ellipsoids", *believed_points(snapshot))
        self._log_points("belief/expected", snapshot.expected_landmarks, EXPECTED, 0.015)
        self._log_image(snapshot)
        self._log_curves(core, info)
        command = command_text(snapshot.motion.name, snapshot.gaze.name)
        if command != self._command and not first:
            self._stream.log("command", self._rr.TextLog(command))
            self._command = command

    def _log_setting(self, scenario: Scenario) -> None:
        """The axes, the room and the cameras' lenses."""
        rr = self._rr
        self._stream.log("world", rr.ViewCoordinates.LUF, static=True)
        room = rr.Boxes3D(half_sizes=[np.array(scenario.room_size) / 2], colors=rgb(MUTED))
        self._stream.log("world/room", room, static=True)
        for whose, colour in WHOSE.items():
            lens = rr.Pinhole(
                focal_length=scenario.focal_px,
                principal_point=(scenario.principal_x_px, scenario.principal_y_px),
                resolution=(scenario.image_width, scenario.image_height),
                camera_xyz=rr.ViewCoordinates.LUF,
                image_plane_distance=0.1 * min(scenario.room_size),
                color=rgb(colour)[0],
            )
            self._stream.log(f"world/{whose}/camera", lens, static=True)
        for name, colour in (("error", CAMERA), ("two_sigma", MUTED)):
            line = rr.SeriesLines(colors=rgb(colour), names=[f"{name} [m]"])
            self._stream.log(f"position/{name}", line, static=True)

    def _log_points(self, name: str, points: np.ndarray, colour: str, radius: float, static: bool = False) -> None:
        shown = self._rr.Points3D(points, colors=rgb(colour), radii=[radius])
        self._stream.log(f"world/{name}", shown, static=static)

    def _log_camera(self, whose: str, position: np.ndarray, quaternion: np.ndarray) -> None:
        """A pose and the path so far; nothing where a lost filter has no finite pose."""
        if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
            return
        rr, path = self._rr, self._paths[whose]
        path.append(position)
        pose = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=np.roll(quaternion, -1)))
        self._stream.log(f"world/{whose}/camera", pose)
        self._stream.log(f"world/{whose}/path", rr.LineStrips3D([np.array(path)], colors=rgb(WHOSE[whose])))

    def _log_image(self, snapshot: Snapshot) -> None:
        """Detected pixels over the predicted ellipses."""
        gates, pixels = ellipses(*predicted_pixels(snapshot), GATE_SIGMAS), np.reshape(snapshot.detections, (-1, 2))
        strips = self._rr.LineStrips2D(gates, colors=rgb(MAPPED))
        self._stream.log("world/belief/camera/predicted", strips)
        points = self._rr.Points2D(pixels, colors=rgb(TRUTH), radii=[2.0])
        self._stream.log("world/belief/camera/detected", points)

    def _log_curves(self, core: Any, info: dict[str, Any]) -> None:
        """Entropy and its parts, errors beside the filter's own deviation."""
        variance = float(np.trace(core.belief.covariance[:3, :3]))
        curves = {name: info[name] for name in _CURVES if name in info}
        curves |= {f"log2_det/{part}": value for part, value in info["log2_det"].items()}
        curves["position/error"] = curves.pop("position_error")
        curves["position/two_sigma"] = 2.0 * np.sqrt(max(variance, 0.0))
        for name, value in curves.items():
            if np.isfinite(value):
                self._stream.log(name, self._rr.Scalars(float(value)))


def _views() -> Any:
    """The map beside the image, over the curves; on white, since the colours are those of `rendering`."""
    import rerun.blueprint as rrb

    white = rrb.Background(color=(255, 255, 255))
    room = rrb.Spatial3DView(name="Map", origin="world", background=white)
    image = rrb.Spatial2DView(name="Camera image", origin="world/belief/camera", background=white)
    beside = rrb.Vertical(image, rrb.TextLogView(name="Command", origin="command"))
    titles = {
        "entropy": "Entropy [bit]",
        "log2_det": "log2 |P|",
        "position": "Position error and its 2 sigma [m]",
        "landmarks_mapped": "Landmarks mapped",
    }
    curves = rrb.Horizontal(*(rrb.TimeSeriesView(name=title, origin=origin) for origin, title in titles.items()))
    views = rrb.Vertical(rrb.Horizontal(room, beside, column_shares=[2, 1]), curves, row_shares=[3, 1])
    return rrb.Blueprint(views, collapse_panels=True)
