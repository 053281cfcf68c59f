"""The sensor `images`: a rendered camera and a front end, which searches it for the features of the filter."""

from functools import partial

import numpy as np

from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.envs.perception import Perception
from activeslam_gym.envs.run import NO_OWNER, UNKNOWN, Run, write_whole_estimate
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import end_frame
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import WAITING
from activeslam_gym.kernels import compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.detection import REJECTED
from activeslam_gym.slam.estimate import index_of
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.kalman import update_contact
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.room.camera import FollowedPoints, RoomCamera, introduce_target
from activeslam_gym.vision.search import Photograph
from activeslam_gym.vision.settings import SIGHTED
from activeslam_gym.world.simulator import CLUTTER_LABEL

WRONG_PX = 4.0
"""A match farther than this from where its point really is in the image is wrong: the noise is under a pixel."""
_COUNTED = ("deletions", "conversions", "restarts")
"""Events that the filter counts."""


class ImagePerception(Perception):
    """The camera of one run, and the front end that feeds the run's belief with what it finds in the images.

    ``start`` (7,): the pose at which the belief expects the camera first.
    """

    def __init__(self, setting: Setting, run: Run, start: np.ndarray, seed: np.random.SeedSequence) -> None:
        self._camera = RoomCamera(setting.scenario, setting.models.true_lens, seed, start=start)
        run.world.fiducials[:] = self._camera.fiducials
        run.world.boxes[:] = self._camera.scene.boxes
        run.world.state.boxes = len(self._camera.scene.boxes)
        self._filter = Filter(setting.scenario, fiducials=self._camera.fiducials)
        self._front_end = FrontEnd(self._filter, SIGHTED)
        introduce_target(self._front_end, self._camera.fiducials, start)
        self._spare = run.world.landmarks.copy()
        self._followed = FollowedPoints(self._camera)
        self._photograph = self._photographed(run, 0)

    @property
    def image(self) -> np.ndarray:
        """(H, W) uint8 the last image."""
        return self._photograph.whole

    def _photographed(self, run: Run, frame: int) -> Photograph:
        return Photograph(partial(self._camera.photograph, run.world.state.camera.copy(), frame))

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Photograph the room, and let the front end search it, under the known accelerations ``u`` (6,)."""
        self._filter.attach(run.ekf)
        if contact:
            update_contact(run.ekf, u, float(run.models.motion.dt))
        self._look(run, u)
        write_whole_estimate(run)
        ids = run.estimate.landmark["id"][: int(run.estimate.state.count)]
        run.first_seen[: len(ids)] = self._front_end.first_seen(ids)
        self._front_end.add_feature_bias(run.estimate)
        judge_by_scene(run, self._followed.of(ids), self._spare)

    def _look(self, run: Run, u: np.ndarray) -> None:
        state, counts = run.world.state.camera, self._filter.counts
        frame = int(run.world.state.frame) + 1
        self._photograph = self._photographed(run, frame)
        log = self._front_end.step(self._photograph, frame * float(run.models.motion.dt), u)
        found, events = self._front_end.candidates, run.episode.events
        self._followed.look(state, self._photograph, found)
        events.initialised += log.initialised
        events.rejected_matches += log.rejected
        for name in _COUNTED:
            events[name] += counts[name]
            counts[name] = 0
        believed_first = found[np.argsort(found["match"] == REJECTED, kind="stable")][: len(run.detections)]
        run.detections[: len(believed_first)] = believed_first
        run.episode["detection_count"] = len(believed_first)


@compiled
def judge_by_scene(run: Run, scene_points: np.ndarray, spare: np.ndarray) -> None:
    """End the frame, give each of the N slots of the score its scene point, and judge the matches.

    ``scene_points`` (n, 3): of each landmark of the estimate, the scene point that it follows. The
    slot of the expected landmark that a feature has retired is the feature's; of an empty one, ``spare`` (N, 3),
    anywhere in the room, is the truth.
    """
    world, estimate, expected, owner = run.world, run.estimate, run.expected, run.owner
    end_frame(run)
    for k in range(estimate.state.count):
        owner[k].label, owner[k].landmark = UNKNOWN, NO_OWNER
    for e in range(expected.shape[0]):
        k = index_of(estimate, expected[e].feature) if expected[e].feature != WAITING else -1
        if k >= 0:
            owner[k].landmark = e
            copy_into(world.landmarks[e], scene_points[k])
        else:
            copy_into(world.landmarks[e], spare[e])
    for c in range(run.episode.detection_count):
        run.label[c] = _label(run, scene_points, run.detections[c].match, run.detections[c].pixel)


@compiled
def _label(run: Run, scene_points: np.ndarray, match: int, pixel: np.ndarray) -> int:
    """The source of a detection that the filter took for ``match``: see `Labels`. Counts a wrong match."""
    world, K = run.world, run.world.fiducials.shape[0]
    k = index_of(run.estimate, match) if match > 0 else -1
    if k >= 0:
        point = scene_points[k]
        label = K + run.owner[k].landmark if run.owner[k].landmark != NO_OWNER else CLUTTER_LABEL
    elif -K <= match < 0:
        point, label = world.fiducials[-1 - match], -1 - match
    else:
        return CLUTTER_LABEL
    z, pose = np.empty(2), world.state.camera
    p_C = camera_point(rotation_matrix(pose[QUATERNION]), pose, point)
    seen = pixel_from_camera_point(run.models.true_lens, p_C, z)
    if not seen or (z[0] - pixel[0]) ** 2 + (z[1] - pixel[1]) ** 2 > WRONG_PX**2:
        run.episode.events.wrong_matches += 1
        return CLUTTER_LABEL
    return label
