"""A camera in a room: the source of rendered images, each a function of the seed, the pose and the frame alone; and the
ground truth of features, the scene points that they follow, by their pixels and the true poses."""

from functools import partial

import numpy as np

from activeslam_gym.camera import world_from_camera
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import quaternion_product, rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.room.geometry import points_in_sight
from activeslam_gym.vision.room.render import Sensor, lens_of, render
from activeslam_gym.vision.room.scene import ORIGIN, SHEET_SIZE, TARGET_SIZE, draw_scene
from activeslam_gym.vision.search import Photograph
from activeslam_gym.vision.target import FACING, Rectangle, printed_rectangle
from activeslam_gym.vision.views import pixels_of

TARGET_CORNERS = 4  # fiducials of a room: the corners of its target
_TARGET = Rectangle(*TARGET_SIZE, np.zeros((TARGET_CORNERS, 2)))
_AHEAD = np.array((0.0, 0.0, 1.0))  # the target's normal, away from the camera
_SOFTNESS = 0.6  # deviation by which pictures of it are blurred: the lens, and the filter of the texture [px]


class RoomCamera:
    """Photographs the room of ``seed``, with noise of its own; its ``lens`` is the true one, see `lens_of`; the target
    is before ``start`` (7,), a pose along an axis of the room.

    ``scene``: the room; `fiducials` (4, 3) [m]: the corners of its target; ``lens``: its rays.
    """

    def __init__(
        self,
        scenario: Scenario,
        lens: Record,
        seed: np.random.SeedSequence,
        rays: np.ndarray | None = None,
        start: np.ndarray = ORIGIN,
    ) -> None:
        room, noise = seed.spawn(2)
        self.scene = draw_scene(scenario, np.random.default_rng(room), start)
        self.fiducials = self.scene.target
        self._sensor, self.lens = Sensor(), lens_of(lens, rays)
        self._key = noise.generate_state(1, np.uint64)
        self._whole = np.array([[0, lens.width, 0, lens.height]], np.int64)

    def photograph(self, state: np.ndarray, frame: int, windows: np.ndarray | None = None) -> np.ndarray:
        """The image (H, W) uint8 of ``frame`` from ``state`` (13,): position, quaternion, and their velocities; or its
        ``windows`` (n, 4), see `Photograph`."""
        shown = self._whole if windows is None else windows
        return render(self.scene, self.lens, self._sensor, state, frame, self._key, shown)

    def points(self, state: np.ndarray, pixel: np.ndarray, image: np.ndarray) -> np.ndarray:
        """(m, 3) [m] what a feature at ``pixel`` (2,) of the ``image`` from ``state`` may follow, likeliest first."""
        return points_in_sight(self.scene, state, self.lens.camera, image, pixel)


def introduce_target(front_end: FrontEnd, fiducials: np.ndarray, start: np.ndarray = ORIGIN) -> None:
    """Tell the front end the looks of the ``fiducials`` (4, 3): corners of the room's target before ``start`` (7,)."""
    facing = quaternion_product(FACING, start[3:] * (1, -1, -1, -1))
    normal = np.array(world_from_camera(rotation_matrix(start[3:]), _AHEAD))
    front_end.show(partial(target_seen, front_end.camera, fiducials.mean(axis=0), facing=facing), normal)


def target_seen(
    camera: Record, middle: np.ndarray, pose: np.ndarray, k: int, facing: np.ndarray = FACING
) -> tuple[np.ndarray, np.ndarray]:
    """The target around ``middle`` (3,) as it should look from ``pose`` (7,), near its corner ``k``, and that corner's
    pixel: `printed_rectangle`.

    ``facing`` (4,): the turn of the world into the frame of the target.
    """
    place = world_from_camera(rotation_matrix(facing), pose[:3] - middle)
    own = np.concatenate((place, quaternion_product(facing, pose[3:])))
    return printed_rectangle(camera, _TARGET, SHEET_SIZE, own, k, _SOFTNESS)


_TELLING = 2.0  # a match distinguishes points that are seen so far apart [px]: it has a lasting error of its own
_GROSS = 16.0  # a match that is farther off [px^2] says no more of a point than this


class FollowedPoints:
    """Of each feature that a front end finds in the images of a room, the scene point that its template follows.

    Where a template shows several planes, one cannot tell from its first image which of them it will follow: at the
    crossing of a near edge and something behind it, that depends on how the camera moves. It is the likeliest, or
    another that the pixels of the matches have agreed with better, from the true poses.
    """

    def __init__(self, camera: RoomCamera) -> None:
        self._camera = camera
        self._points: dict[int, np.ndarray] = {}  # by id, (m, 3), the likeliest first
        self._gains: dict[int, np.ndarray] = {}  # by id, (m,): by so much each agrees better than the first [px^2]

    def look(self, state: np.ndarray, image: np.ndarray | Photograph, found: np.ndarray) -> None:
        """Take what was ``found`` (M,) DETECTION in the ``image`` from the true ``state``: matches, and features that
        were initialised, which have no ``id``."""
        for id, match, pixel in zip(found["id"].tolist(), found["match"].tolist(), found["pixel"]):
            if match > 0 and id != match:
                whole = image.whole if isinstance(image, Photograph) else image
                self._points[match] = points = self._camera.points(state, pixel, whole)
                self._gains[match] = np.zeros(len(points))
            elif match > 0 and len(self._points[match]) > 1:
                seen = pixels_of(self._camera.lens.camera, state, self._points[match])
                errors = np.minimum(((seen - pixel) ** 2).sum(axis=1), _GROSS)
                apart = ((seen - seen[0]) ** 2).sum(axis=1) > _TELLING**2
                self._gains[match] += np.where(apart, errors[0] - errors, 0.0)

    def of(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) of the features ``ids`` (n,) [m]."""
        return np.array([self._points[id][self._gains[id].argmax()] for id in ids.tolist()]).reshape(-1, 3)
