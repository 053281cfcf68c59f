"""The ground truth of a front end's features: the scene points that they follow, by their pixels and the true poses."""

import numpy as np

from activeslam_gym.vision.room.camera import RoomCamera

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

    def look(self, state: np.ndarray, image: np.ndarray, found: np.ndarray) -> None:
        """Take what was ``found`` (M,) DETECTION in the ``image`` from the true ``state``: matches, and features that
        were initialised, which have no ``id``."""
        for id, match, pixel in zip(found["id"].tolist(), found["match"].tolist(), found["pixel"]):
            if match > 0 and id != match:
                self._points[match] = points = self._camera.points(state, pixel, image)
                self._gains[match] = np.zeros(len(points))
            elif match > 0 and len(self._points[match]) > 1:
                seen = self._camera.pixels(state, self._points[match])
                errors = np.minimum(((seen - pixel) ** 2).sum(axis=1), _GROSS)
                apart = ((seen - seen[0]) ** 2).sum(axis=1) > _TELLING**2
                self._gains[match] += np.where(apart, errors[0] - errors, 0.0)

    def of(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) of the features ``ids`` (n,) [m]."""
        return np.array([self._points[id][self._gains[id].argmax()] for id in ids.tolist()]).reshape(-1, 3)
