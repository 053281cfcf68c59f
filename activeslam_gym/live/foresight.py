"""What the front end would see from somewhere else: less than what is there.

It knows a feature by its looks, so not from every side; and it bears features only while few are in view. Advice that
counts on more sends people where it does not happen.
"""

import numpy as np

from activeslam_gym.camera import View, visible
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.candidates import Prospect
from activeslam_gym.kernels import Record
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.slam.belief import RAY
from activeslam_gym.vision.frontend import FrontEnd


def foreseen(prospect: Prospect, front_end: FrontEnd, pose: np.ndarray) -> Prospect:
    """The ``prospect`` as the front end would see it from ``pose`` (13,): the rest is put behind the camera.

    Nothing else changes, so that scores are of the same whole. Not seen are features from a side where it does not
    search them, and expected landmarks for which there is no room beside the features in view: it bears no more there.
    """
    points, known = prospect.points.copy(), len(prospect.points) - prospect.waiting
    camera, features, expected = front_end.camera, points[:known], points[known:]
    behind = pose[POSITION] - rotation_matrix(pose[QUATERNION])[:, 2]
    kinds = front_end.filter.belief.feature["kind"][: len(front_end.filter.ids)]
    ids = front_end.filter.ids[kinds != RAY]  # a prospect has none
    features[front_end.change_of_view(ids, features, pose[POSITION]) > front_end.settings.most_change] = behind
    in_view = np.concatenate((features, prospect.fiducials))
    room = front_end.settings.visible - np.count_nonzero(_visible(camera, prospect.boxes, pose, in_view))
    seen = np.flatnonzero(_visible(camera, prospect.boxes, pose, expected))
    expected[seen[max(room, 0) :]] = behind  # any of them: nobody knows where they are
    return prospect._replace(points=points)


def _visible(camera: Record, boxes: np.ndarray, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m,) bool: which of the ``points`` (m, 3) are in view from ``pose`` (13,)."""
    view, z = View(camera, pose, rotation_matrix(pose[QUATERNION]), boxes), np.empty(2)
    return np.array([visible(view, point, 0.0, z) for point in points], bool)
