"""Views: from a pose, of points and of the plane Z = 0 of the target's frame; and the difference of two views."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import (
    View,
    camera_point,
    change_of_view,
    pixel_from_camera_point,
    ray_from_pixel,
    world_from_camera,
)
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import QUATERNION, transition
from activeslam_gym.slam.sight import point_measurement
from activeslam_gym.vision.opencv import opencv

_MOMENT = 1e-3  # over which speeds are measured [s]


def reduced(image: np.ndarray, scale: float) -> np.ndarray:
    """The ``image`` (h, w) with the mean of each ``scale`` x ``scale`` pixels as one; what is left over is cut off. A
    ``scale`` of 1/2 makes it twice as large, linearly between the pixels."""
    if scale == 1:
        return np.ascontiguousarray(image)
    cv2, (h, w) = opencv(), (int(side / scale) for side in image.shape)
    kept = image if scale < 1 else image[: int(h * scale), : int(w * scale)]
    return cv2.resize(kept, (w, h), interpolation=cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR)


def view_from(camera: Record, pose: np.ndarray) -> View:
    """The view of a CAMERA from ``pose`` (>= 7,), with nothing that hides."""
    return View(camera, pose, rotation_matrix(pose[3:7]))


@compiled
def plane_points(camera: Record, pose: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(len(y), len(x), 2) where the rays of the pixels (x, y) from ``pose`` (>= 7,) meet the plane [m]; NaN if not."""
    out, pixel, R_WC = np.empty((len(y), len(x), 2)), np.empty(2), rotation_matrix(pose[QUATERNION])
    for i in range(len(y)):
        for j in range(len(x)):
            pixel[0], pixel[1] = x[j], y[i]
            d = world_from_camera(R_WC, ray_from_pixel(camera, pixel))
            for k in range(2):
                out[i, j, k] = pose[k] - pose[2] * d[k] / d[2] if d[2] < 0.0 else np.nan
    return out


@compiled
def pixels_of(camera: Record, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) the pixels of ``points`` (n, 3) [m] from ``pose`` (>= 7,); NaN of one behind the camera."""
    R_WC, out = rotation_matrix(pose[QUATERNION]), np.full((points.shape[0], 2), np.nan)
    for k in range(points.shape[0]):
        if not pixel_from_camera_point(camera, camera_point(R_WC, pose, points[k]), out[k]):
            out[k] = np.nan
    return out


def projected(camera: Record, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The same; a ValueError, if one is behind the camera."""
    if np.isnan(out := pixels_of(camera, pose, points)).any():
        raise ValueError("a corner of the target is behind the camera")
    return out


@compiled
def pixels_and_jacobian(camera: Record, pose: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) as of `pixels_of`, and their Jacobian (2 n, 6) by position and rotation (world frame)."""
    view, out = View(camera, pose, rotation_matrix(pose[QUATERNION])), np.full((points.shape[0], 2), np.nan)
    J, H_y = np.zeros((2 * points.shape[0], 6)), np.empty((2, 3))
    for k in range(points.shape[0]):
        if not point_measurement(view, points[k], out[k], J[2 * k : 2 * k + 2], H_y):
            out[k] = np.nan
    return out, J


@compiled
def _steps(camera: Record, mean: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) ways of the ``points`` (n, 3) [m] in the image of a camera with the ``mean`` (13,) in a moment [px]."""
    return pixels_of(camera, transition(mean, np.zeros(6), _MOMENT), points) - pixels_of(camera, mean, points)


@compiled
def speeds(camera: Record, mean: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) speeds of the ``points`` (n, 3) [m] in the image of a camera with the ``mean`` (13,) [px/s]; 0 behind it."""
    step = _steps(camera, mean, points)
    out = np.hypot(step[:, 0], step[:, 1]) / _MOMENT
    return np.where(np.isnan(out), 0.0, out)


def velocities(camera: Record, mean: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) the same as vectors."""
    return np.nan_to_num(_steps(camera, mean, points)) / _MOMENT


def delayed(camera: Record, mean: np.ndarray, points: np.ndarray, pixels: np.ndarray, readout: float) -> np.ndarray:
    """(n, 2) how far the images of ``points`` (n, 3), at ``pixels`` (n, 2), move from the time of the middle row to
    that of their own, where a rolling shutter reads one row after the other within ``readout`` [s]."""
    if readout == 0.0:
        return np.zeros_like(pixels)
    return row_times(pixels, float(camera.height), readout) * velocities(camera, mean, points)


def row_times(pixels: np.ndarray, height: float, readout: float) -> np.ndarray:
    """(n, 1) when the rows of ``pixels`` (n, 2) are read, after the middle one [s], of the ``height`` of an image."""
    return readout * ((pixels[:, 1:] + 0.5) / height - 0.5)


def point_at(camera: Record, mean: np.ndarray, pixel: np.ndarray, inverse_depth: float) -> np.ndarray:
    """(1, 3) the point that is seen at ``pixel`` (2,) from ``mean`` (>= 7,) at that ``inverse_depth`` [1/m]."""
    ray = ray_from_pixel(camera, pixel)
    return mean[:3] + np.array([world_from_camera(rotation_matrix(mean[QUATERNION]), ray)]) / inverse_depth


def pose_of(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(7,) position and quaternion q_WC of the camera that has a point p at Exp(turn) p + shift, as OpenCV tells it."""
    R_WC = Rotation.from_rotvec(turn.ravel()).inv()
    return np.concatenate((-R_WC.apply(shift.ravel()), np.roll(R_WC.as_quat(), 1)))


@compiled
def is_outdated(drawn_from: np.ndarray, now: np.ndarray, point: np.ndarray, most: float) -> bool:
    """Whether the pose (7,) that ``point`` (3,) was drawn for differs from ``now`` (>= 7,) by a change of view
    or a turn of more than ``most`` [rad], or is NaN."""
    cosine = abs(np.sum(drawn_from[QUATERNION] * now[QUATERNION]))
    same = change_of_view(drawn_from, now, point) <= most and 2.0 * math.acos(min(1.0, cosine)) <= most
    return math.isnan(cosine) or not same


@compiled
def changes_of_view(first: np.ndarray, now: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) the `change_of_view` of each of ``points`` (n, 3) from ``first`` (n, >= 3) to ``now`` (>= 3,) [rad]."""
    out = np.empty(points.shape[0])
    for k in range(out.shape[0]):
        out[k] = change_of_view(first[k], now, points[k])
    return out
