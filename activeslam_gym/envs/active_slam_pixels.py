"""``ActiveSLAMPixels-v0``: the same environment on images of a textured room instead of points."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.config import CENTRE, INVERSE_DEPTH, UNIFORM, Scenario, scenario_from
from activeslam_gym.envs.active_slam import ActiveSLAMEnv
from activeslam_gym.envs.active_slam_vector import ActiveSLAMVectorEnv
from activeslam_gym.envs.episode import BEGIN, REST
from activeslam_gym.envs.public import Reads
from activeslam_gym.envs.sensed import account, begin, enter, finish, move
from activeslam_gym.envs.simulation import Run, Setting
from activeslam_gym.envs.snapshot import Snapshot
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.expectation import WAITING
from activeslam_gym.kernels import row
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.association import REJECTED
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.frontend import FrontEnd, FrontEndSettings
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.room.camera import TARGET_CORNERS, RoomCamera, introduce_target
from activeslam_gym.vision.room.scene import BOX_COUNT

SIGHTED = FrontEndSettings(
    visible=16, births=3, room_below=8, least_clear=0, clear=0.0, lens_std=0.0, floor_std=0.05, grain=25.0, drift=0.6,
    fiducial_std=0.025, fiducial_grain=7.0, looks=28.0, most_change=0.7, least_score=0.87, most_residual=0.22,
    least_ratio=0.22,
)  # fmt: skip
"""The front end of a camera whose lens is known, in a room whose map should hold all of it."""
_COUNTED = ("births", "deletions", "rejected_matches", "conversions")
"""Events of the front end and the filter."""
_DEMANDED: dict[str, Any] = {
    "fiducial_count": TARGET_CORNERS,
    "initialisation": INVERSE_DEPTH,
    "boxes": (),
    "box_count": (0, 0),
    "inner_walls": (0, 0),
    "landmark_layout": UNIFORM,
    "start": CENTRE,
    "varied": (),
    "maximum_distance": None,
    "clutter_rate": 0.0,
    "missed_detection_probability": 0.0,
    "labelled_first_match": False,
}
"""Fields of a scenario, as images need them."""


class Eye:
    """The camera of one run, and the front end that feeds the run's belief with what it finds in the images."""

    def __init__(self, setting: Setting, run: Run, seed: np.random.SeedSequence) -> None:
        self._camera = RoomCamera(setting.scenario, setting.models.true_camera, seed)
        run.world.fiducials[:] = self._camera.fiducials
        run.world.boxes[:] = self._camera.scene.boxes
        run.world.state.boxes = len(self._camera.scene.boxes)
        self._filter = Filter(setting.scenario, fiducials=self._camera.fiducials, products_last=False)
        self._front_end = FrontEnd(self._filter, SIGHTED)
        introduce_target(self._front_end, self._camera.fiducials)
        self.spare = run.world.landmarks.copy()
        self._scene_points: dict[int, np.ndarray] = {}
        self.newest: set[int] = set()
        """Ids of the features that the last image initialised."""
        self.image = self._camera.photograph(run.world.state.camera, 0)

    def look(self, run: Run, u: np.ndarray) -> None:
        """Photograph the room, and let the front end make what it can of it, under the known accelerations ``u``."""
        state, belief, counts = run.world.state.camera, run.belief, self._filter.counts
        frame = int(run.world.state.frame) + 1
        self.image = self._camera.photograph(state, frame)
        self._filter.belief = belief
        counts["conversions"] = 0
        log = self._front_end.step(self.image, frame * float(run.models.motion.dt), u)
        found, events = self._front_end.candidates, run.episode.events
        born = found[len(found) - log.births :]
        self.newest = set(born["match"].tolist())
        for id, pixel in zip(born["match"].tolist(), born["pixel"]):
            self._scene_points[id] = self._camera.point(state, pixel)
        for name, count in zip(_COUNTED, (log.births, log.deletions, log.rejected, int(counts["conversions"]))):
            events[name] += count
        believed_first = found[np.argsort(found["match"] == REJECTED, kind="stable")][: len(run.candidate)]
        run.candidate[: len(believed_first)] = believed_first
        run.episode["detections"] = len(believed_first)

    def scene_points(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) of the features ``ids`` (n,): the scene point of the pixel that initialised each [m]."""
        return np.array([self._scene_points[id] for id in ids.tolist()]).reshape(-1, 3)


# The environments ---------------------------------------------------------------------------------------------------


class _Sighted(Reads):
    """Runs with eyes: what both environments have."""

    def _open_eyes(self) -> None:
        """Before the first reset.

        Raises:
            ModuleNotFoundError: OpenCV is not installed.
        """
        opencv()
        world, count = self._runs.world, len(self._runs.episode)
        self._runs = self._runs._replace(world=world._replace(boxes=np.zeros((count, BOX_COUNT, 2, 3))))
        self._eyes: list[Any] = [None] * count

    def _reset_run(self, i: int, key: int) -> None:
        super()._reset_run(i, key)
        seed = np.random.SeedSequence(key).spawn(5)[-1]  # the redraws use it, and not its children
        self._eyes[i] = Eye(self.setting, row(self._runs, i), seed)

    def _play(self, phases: np.ndarray, commands: np.ndarray) -> None:
        self._workers.call(self._play_rows, phases, commands)

    def _play_rows(self, phases: np.ndarray, commands: np.ndarray, start: int, stop: int) -> None:
        """`episode.play`, with images for detections."""
        runs = self._runs
        for i in range(start, stop):
            eye = self._eyes[i]
            if phases[i] == BEGIN:
                begin(runs, i)
            elif phases[i] != REST:
                for frame in range(int(self.setting.task.frames_per_step)):
                    u = move(runs, i, commands[i], frame == 0)
                    run = row(runs, i)
                    eye.look(run, u)
                    enter(runs, i)
                    ids = run.estimate.landmark["id"][: int(run.estimate.state.count)]
                    account(runs, i, eye.scene_points(ids), eye.spare)
                finish(runs, i)

    def _seen(self, snapshot: Snapshot, i: int) -> Snapshot:
        """The snapshot of environment ``i`` with its image; of the truth, the scene points that features stand for."""
        run = row(self._runs, i)
        stands = run.expected["serial"] != WAITING
        return dataclasses.replace(snapshot, image=self._eyes[i].image, true_landmarks=run.world.landmarks[stands])


class ActiveSLAMPixelsEnv(_Sighted, ActiveSLAMEnv):
    """`ActiveSLAMEnv` on images: the same actions, observation, rewards, scores and ends, and another sensor.

    The room has textured walls, posters, and boxes that hide what is behind them. Its image is rendered through the
    lens, with noise, blur of motion and drifting gain, and is a function of the seed, the frame and the camera's true
    state alone. The front end of `vision` searches the features of the belief in it, and adds and drops features. The
    fiducials are the four corners of a black rectangle of known size, which hangs before the start.

    What differs:

    - ``scenario`` is ``"pixels"`` by default. Its ``fiducial_count`` must be 4, its ``initialisation``
      ``inverse_depth``, and it must have no ``boxes`` (drawn ones and inner walls neither), no clutter, no missed
      detections and no labelled first match: the image has its own. Layout of the landmarks, start and greatest
      distance stay as in ``paper``, and nothing is varied.
    - ``landmark_count``, N, bounds the map (N + 13 features) instead of telling how many points the room has.
    - Truth of a landmark is the scene point of its feature's birth pixel, by ray-casting. Of the N slots of the log
      score, one without a feature scores a random point of the room by the prior.
    - A match is wrong where the feature's scene point is more than 4 pixels from it in the true image.
    - The room's boxes stop the camera, and a motion stops short of them; the belief knows nothing of them, and nothing
      tells how far they are.

    Raises:
        ValueError: a bad argument or action.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(self, scenario: str | Mapping[str, Any] | Scenario = "pixels", **arguments: Any) -> None:
        super().__init__(_checked(scenario), **arguments)
        self._open_eyes()

    def snapshot(self) -> Snapshot:
        """All that a picture of this moment needs, the camera's image included."""
        return self._seen(super().snapshot(), 0)

    @property
    def image(self) -> np.ndarray:
        """(H, W) uint8 the last image; a copy."""
        return self._eyes[0].image.copy()

    def match_errors(self) -> np.ndarray:
        """(m, 6) of the last frame's matches: id, error u, v [px], and the noise R that was assumed, uu, uv, vv [px^2].

        The error is measured - true, by the scene point of the birth pixel. For referees, never for policies.
        """
        run, eye = self._run, self._eyes[0]
        pose, older = run.world.state.camera, set(self.belief.ids.tolist()) - eye.newest
        R_WC, z, out = rotation_matrix(pose[QUATERNION]), np.empty(2), []
        for one in run.candidate[: int(run.episode.detections)]:
            match, R = int(one["match"]), one["R"]
            if match in older or -len(run.world.fiducials) <= match < 0:
                point = eye.scene_points(one["match"][None])[0] if match > 0 else run.world.fiducials[-1 - match]
                pixel_from_camera_point(run.models.true_camera, camera_point(R_WC, pose, point), z)
                out.append((match, *(one["pixel"] - z), R[0, 0], R[0, 1], R[1, 1]))
        return np.reshape(out, (-1, 6))


class ActiveSLAMPixelsVectorEnv(_Sighted, ActiveSLAMVectorEnv):
    """``ActiveSLAMPixels-v0`` a batch at a time: what `ActiveSLAMVectorEnv` is to `ActiveSLAMEnv`."""

    def __init__(
        self, num_envs: int = 1, scenario: str | Mapping[str, Any] | Scenario = "pixels", **arguments: Any
    ) -> None:
        super().__init__(num_envs, _checked(scenario), **arguments)
        self._open_eyes()

    def snapshot(self, i: int) -> Snapshot:
        """All that a picture of this moment of environment ``i`` needs, the camera's image included."""
        return self._seen(super().snapshot(i), i)


def _checked(scenario: str | Mapping[str, Any] | Scenario) -> Scenario:
    """The scenario, if images can be made of it.

    Raises:
        ValueError: a field is not as `ActiveSLAMPixelsEnv` says.
    """
    resolved = scenario_from(scenario)
    for name, value in _DEMANDED.items():
        if getattr(resolved, name) != value:
            raise ValueError(f"scenario.{name} must be {value!r} for images, got {getattr(resolved, name)!r}")
    return resolved
