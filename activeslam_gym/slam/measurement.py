"""What the camera is expected to see: predicted pixels, their Jacobians and innovation covariances.

Rows are numbered alike everywhere in `slam`: row r < K is fiducial r, row K + s is the feature in slot s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import (
    CameraModel,
    Vector,
    camera_from_world,
    inside_image,
    pixel_from_camera_point,
    pixel_jacobian,
)
from activeslam_gym.compilation import part
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.belief import FEATURES, INVERSE_DEPTH, KIND_DIM, POINT, Belief, bearing

POSE_DIM = 6
"""A pixel depends on the leading 6 dimensions of the camera's tangent: position and rotation."""
SEARCH_STDS = 4.3
"""A feature is searched for when its predicted pixel is within so many standard deviations of the image: the radius of
the birth gate, so that no known feature is born again just outside."""
INSIDE_STDS = 3.0
"""Its absence is telling when its predicted pixel is so many standard deviations inside."""

UNSEEN, NEAR, INSIDE = 0, 1, 2
"""A row is not predicted in view; within reach of the image; well inside it, so that a miss is telling."""


class Predictions(NamedTuple):
    """Predicted measurements, by row (K fiducials, then F slots)."""

    visibility: np.ndarray
    """(K + F,) UNSEEN, NEAR or INSIDE."""
    z_hat: np.ndarray
    """(K + F, 2) [px]."""
    S: np.ndarray
    """(K + F, 2, 2) innovation covariance [px^2]."""
    H_camera: np.ndarray
    """(K + F, 2, 6) by the camera's position and rotation."""
    H_feature: np.ndarray
    """(K + F, 2, 6) by the feature's parameters; zero for fiducials."""


@part
def empty_predictions(rows: int) -> Predictions:
    """Room for ``rows`` rows, all UNSEEN."""
    return Predictions(
        np.zeros(rows, np.int64),
        np.zeros((rows, 2)),
        np.zeros((rows, 2, 2)),
        np.zeros((rows, 2, POSE_DIM)),
        np.zeros((rows, 2, 6)),
    )


@part
def point_measurement(
    camera: CameraModel,
    pose: np.ndarray,
    R_WC: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    H_x: np.ndarray,
    H_y: np.ndarray,
) -> bool:
    """Pixel of the world point ``y`` (>= 3,) from ``pose`` (>= 3, position first), with its Jacobians.

    p_C = R^T (y - p); with R = Exp(dtheta) R_hat, dp_C/d dtheta = R^T [y - p]x. Writes ``z`` (2,), ``H_x`` (2, 6) by
    position and rotation, and ``H_y`` (2, >= 3). False where the point is nearer than the camera's minimum depth.
    """
    d = (y[0] - pose[0], y[1] - pose[1], y[2] - pose[2])
    p_C = camera_from_world(R_WC, d)
    if p_C[2] < camera.minimum_depth or not pixel_from_camera_point(camera, p_C, z):
        return False
    _chain(camera, p_C, R_WC, d, 1.0, H_x, H_y)
    return True


@part
def _chain(
    camera: CameraModel,
    p_C: Vector,
    R_WC: np.ndarray,
    d: Vector,
    scale: float,
    H_x: np.ndarray,
    H_y: np.ndarray,
) -> None:
    """J = dz/dp_C R^T; H_y[:, :3] = scale J (by a world point), H_x = [-scale J, J [d]x]."""
    J_C = np.empty((2, 3))
    pixel_jacobian(camera, p_C, J_C)
    for i in range(2):
        for j in range(3):
            value = J_C[i, 0] * R_WC[j, 0] + J_C[i, 1] * R_WC[j, 1] + J_C[i, 2] * R_WC[j, 2]
            H_y[i, j] = scale * value
            H_x[i, j] = -scale * value
        a, b, c = H_y[i, 0] / scale, H_y[i, 1] / scale, H_y[i, 2] / scale
        H_x[i, 3] = b * d[2] - c * d[1]
        H_x[i, 4] = c * d[0] - a * d[2]
        H_x[i, 5] = a * d[1] - b * d[0]


@part
def inverse_depth_measurement(
    camera: CameraModel,
    pose: np.ndarray,
    R_WC: np.ndarray,
    feature: np.ndarray,
    z: np.ndarray,
    H_x: np.ndarray,
    H_y: np.ndarray,
) -> bool:
    """Pixel of an inverse-depth feature (anchor, azimuth, elevation, rho) with its Jacobians; see point_measurement.

    Projection does not see scale, so h = R^T d with d = rho (anchor - p) + m stands for the point: it stays finite as
    rho goes to zero (Montiel, Civera and Davison 2006, equation 7). ``H_y`` is (2, 6).
    """
    rho = feature[5]
    m = bearing(feature[3], feature[4])
    offset = (feature[0] - pose[0], feature[1] - pose[1], feature[2] - pose[2])
    d = (rho * offset[0] + m[0, 0], rho * offset[1] + m[0, 1], rho * offset[2] + m[0, 2])
    p_C = camera_from_world(R_WC, d)
    if p_C[2] < camera.minimum_depth * rho or not pixel_from_camera_point(camera, p_C, z):
        return False
    _chain(camera, p_C, R_WC, d, rho, H_x, H_y)
    for i in range(2):
        a, b, c = H_y[i, 0] / rho, H_y[i, 1] / rho, H_y[i, 2] / rho
        H_y[i, 3] = a * m[1, 0] + b * m[1, 1] + c * m[1, 2]
        H_y[i, 4] = a * m[2, 0] + b * m[2, 1] + c * m[2, 2]
        H_y[i, 5] = a * offset[0] + b * offset[1] + c * offset[2]
    return True


@part
def measure(
    camera: CameraModel,
    pose: np.ndarray,
    R_WC: np.ndarray,
    kind: int,
    parameters: np.ndarray,
    z: np.ndarray,
    H_x: np.ndarray,
    H_y: np.ndarray,
) -> bool:
    """The measurement of a feature of that ``kind`` with its Jacobians. False if it cannot be measured or is a RAY."""
    if kind == POINT:
        return point_measurement(camera, pose, R_WC, parameters, z, H_x, H_y)
    return kind == INVERSE_DEPTH and inverse_depth_measurement(camera, pose, R_WC, parameters, z, H_x, H_y)


@part
def depth_of(R_WC: np.ndarray, pose: np.ndarray, y: np.ndarray) -> float:
    """Distance of the world point ``y`` (>= 3,) along the optical axis [m]."""
    return R_WC[0, 2] * (y[0] - pose[0]) + R_WC[1, 2] * (y[1] - pose[1]) + R_WC[2, 2] * (y[2] - pose[2])


@part
def own_innovation(
    P: np.ndarray, start: int, width: int, H_x: np.ndarray, H_y: np.ndarray, pixel_var: float, S: np.ndarray
) -> None:
    """S (2, 2) = H P H^T + R, with H non-zero on the pose and on ``width`` columns from ``start`` on."""
    s00, s01, s11 = pixel_var, 0.0, pixel_var
    for a in range(POSE_DIM):
        h0, h1 = H_x[0, a], H_x[1, a]
        own0, own1, cross0, cross1 = 0.0, 0.0, 0.0, 0.0
        for b in range(POSE_DIM):
            own0 += P[a, b] * H_x[0, b]
            own1 += P[a, b] * H_x[1, b]
        for b in range(width):
            cross0 += P[a, start + b] * H_y[0, b]
            cross1 += P[a, start + b] * H_y[1, b]
        s00 += h0 * (own0 + 2.0 * cross0)
        s01 += h0 * (own1 + cross1) + h1 * cross0
        s11 += h1 * (own1 + 2.0 * cross1)
    for a in range(width):
        own0, own1 = 0.0, 0.0
        for b in range(width):
            own0 += P[start + a, start + b] * H_y[0, b]
            own1 += P[start + a, start + b] * H_y[1, b]
        s00 += H_y[0, a] * own0
        s01 += H_y[0, a] * own1
        s11 += H_y[1, a] * own1
    S[0, 0], S[0, 1], S[1, 0], S[1, 1] = s00, s01, s01, s11


@part
def predict_measurements(camera: CameraModel, belief: Belief, fiducials: np.ndarray) -> Predictions:
    """Predict every fiducial and every feature but the rays."""
    K, pose, P, pixel_var = fiducials.shape[0], belief.camera, belief.covariance, camera.pixel_std**2
    out = empty_predictions(K + belief.kind.shape[0])
    visibility, z_hat, S, H_camera, H_feature = out.visibility, out.z_hat, out.S, out.H_camera, out.H_feature
    R_WC = rotation_matrix(pose[QUATERNION])
    for i in range(K + belief.size[FEATURES]):  # arrays, not tuples: handing on one counts the references of all in it
        slot = belief.order[i - K] if i >= K else -1
        row = K + slot if i >= K else i
        kind, start = (belief.kind[slot], belief.start[slot]) if i >= K else (POINT, 0)
        parameters = belief.feature[slot] if i >= K else fiducials[i]
        if kind == POINT and depth_of(R_WC, pose, parameters) < camera.minimum_depth:
            continue  # most of a map is behind the camera: tell it apart cheaply
        if not measure(camera, pose, R_WC, kind, parameters, z_hat[row], H_camera[row], H_feature[row]):
            continue
        if i < K:
            H_feature[row] = 0.0
        if not inside_image(camera, z_hat[row], camera.width):
            continue
        width = KIND_DIM[kind] if i >= K else 0
        own_innovation(P, start, width, H_camera[row], H_feature[row], pixel_var, S[row])
        visibility[row] = visibility_of(camera, z_hat[row], S[row])
    return out


@part
def visibility_of(camera: CameraModel, z_hat: np.ndarray, S: np.ndarray) -> int:
    """Whether a predicted pixel with covariance ``S`` is UNSEEN, NEAR or INSIDE."""
    longest = math.sqrt(max(S[0, 0], S[1, 1]))
    if inside_image(camera, z_hat, -INSIDE_STDS * longest):
        return INSIDE
    return NEAR if inside_image(camera, z_hat, SEARCH_STDS * longest) else UNSEEN


@part
def squared_distance(z: np.ndarray, z_hat: np.ndarray, S: np.ndarray) -> float:
    """Mahalanobis (z - z_hat)^T S^-1 (z - z_hat) of a pixel (2,)."""
    a, b = z[0] - z_hat[0], z[1] - z_hat[1]
    return (S[1, 1] * a * a - 2.0 * S[0, 1] * a * b + S[0, 0] * b * b) / determinant(S)


@part
def determinant(S: np.ndarray) -> float:
    """|S| of a 2 x 2 matrix."""
    return S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
