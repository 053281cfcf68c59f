"""Sight: predicted measurements of all that is in view, with H by blocks, H P and S. Filter and planner share it.

Rows are numbered alike everywhere: row r < K is fiducial r, row K + k the feature (or the planner's point) k.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import (
    Vector,
    View,
    camera_from_world,
    distance_between,
    in_field_of_view,
    inside_image,
    pixel_from_camera_point,
    pixel_jacobian,
    view_of,
    visible,
)
from activeslam_gym.kernels import Record, borrowing, compiled, record
from activeslam_gym.linalg import add_product_of_two
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import (
    AZIMUTH,
    ELEVATION,
    KIND_DIM,
    NEVER,
    POINT,
    RAY,
    RHO,
    Belief,
    Direction,
    bearing,
    fiducial_id,
    place_of,
)

POSE_DIM = 6  # a pixel depends on the leading 6 dimensions of the camera's tangent: position and rotation
SEARCH_STDS = 4.3
"""A feature is searched for when its predicted pixel is within so many standard deviations of the image: the radius of
the initialisation gate, so that no known feature is initialised twice, just outside."""
INSIDE_STDS = 3.0  # its absence is telling when its predicted pixel is so many standard deviations inside
TELLING_SHARE = 0.85  # and nearer than this share of the greatest distance at which anything is seen

PRODUCT_FRAMES, IMAGE_PRODUCT_FRAMES = 8.0, 3.0
"""The second-order error counts so many times, since it is correlated over as many frames; and in images.

It is the product of two errors, of the camera's way and of an inverse depth, which barely change from frame to frame.
But noise that is overstated makes the filter follow the camera too slowly, and what it lags behind counts as parallax:
a camera that turns on the spot believes its features too near. In images, whose pixels are nearly exact, it is 3 frames
for that reason. With unknown commands the product is counted once in images, where the noise of a feature grows with
its mean residual, and where there are no fiducials, as way and inverse depths then have one free scale.
"""

NEAR, INSIDE = 1, 2  # a row is within reach of the image; well inside it, so that a miss is telling

PREDICTED = record(
    row="i8",
    id="i8",  # of the feature or fiducial; 0 for a planner's point
    column="i8",  # first covariance row of its parameters
    width="i8",  # how many they are: 0 for a fiducial, whose place is known, 2 if its pixel has a bias
    visibility="i8",  # NEAR or INSIDE
    crowded="i8",  # frames since two unexplained detections were in a feature's gate
    unseen="i8",  # frames since a feature's last match, or NEVER; 0 of others
    z_hat=("f8", 2),  # predicted pixel [px]
    H_camera=("f8", (2, POSE_DIM)),  # by the camera's position and rotation
    H_feature=("f8", (2, 6)),  # by the leading ``width`` parameters of the feature
    R=("f8", (2, 2)),  # covariance of the measurement's noise: the lens's own, or a matched detection's [px^2]
    curvature=("f8", (2, 2)),  # covariance of the terms that the linearisation leaves out [px^2]
)
"""One predicted measurement: of a fiducial or a feature in reach."""


class Sight(NamedTuple):
    """The predicted measurements (predictions) of v fiducials and features, in this order, and their covariances."""

    point: np.ndarray
    """(v,) PREDICTED."""
    HP: np.ndarray
    """(2 v, dim) covariance of the predicted pixels with the state [px × unit of the state]."""
    S: np.ndarray
    """(2 v, 2 v) innovation covariance H P H^T + R, and each prediction's ``curvature`` [px^2]."""


@compiled
def pixel_rows(points: np.ndarray) -> np.ndarray:
    """(2 n,) the rows of the pixels of those ``points`` (n,) in a joint covariance."""
    rows = np.empty(2 * points.shape[0], np.int64)
    for k in range(points.shape[0]):
        rows[2 * k], rows[2 * k + 1] = 2 * points[k], 2 * points[k] + 1
    return rows


@borrowing
def point_measurement(view: View, y: np.ndarray, z: np.ndarray, H_x: np.ndarray, H_y: np.ndarray) -> bool:
    """Pixel of the world point ``y`` (>= 3,) with its Jacobians.

    p_C = R^T (y - p); with R = Exp(dtheta) R_hat, dp_C/d dtheta = R^T [y - p]x. Writes ``z`` (2,), ``H_x`` (2, 6) by
    position and rotation, and ``H_y`` (2, >= 3). False where the point is nearer than the camera's minimum depth.
    """
    pose = view.pose
    d = (y[0] - pose[0], y[1] - pose[1], y[2] - pose[2])
    p_C = camera_from_world(view.R_WC, d)
    if p_C[2] < view.lens.minimum_depth or not pixel_from_camera_point(view.lens, p_C, z):
        return False
    _chain(view, p_C, d, 1.0, H_x, H_y)
    return True


@borrowing
def inverse_depth_measurement(view: View, feature: np.ndarray, z: np.ndarray, H_x: np.ndarray, H_y: np.ndarray) -> bool:
    """Pixel of an inverse-depth feature (anchor, azimuth, elevation, rho) with its Jacobians; see point_measurement.

    Projection does not see scale, so h = R^T d with d = rho (anchor - p) + m stands for the point: it stays finite as
    rho goes to zero (Montiel, Civera and Davison 2006, equation 7). ``H_y`` is (2, 6).
    """
    rho, pose = feature[RHO], view.pose
    m = bearing(feature[AZIMUTH], feature[ELEVATION])
    offset = (feature[0] - pose[0], feature[1] - pose[1], feature[2] - pose[2])
    d = (rho * offset[0] + m[0][0], rho * offset[1] + m[0][1], rho * offset[2] + m[0][2])
    p_C = camera_from_world(view.R_WC, d)
    if p_C[2] < view.lens.minimum_depth * rho or not pixel_from_camera_point(view.lens, p_C, z):
        return False
    _chain(view, p_C, d, rho, H_x, H_y)
    for i in range(2):
        a, b, c = H_y[i, 0] / rho, H_y[i, 1] / rho, H_y[i, 2] / rho
        H_y[i, AZIMUTH] = a * m[1][0] + b * m[1][1] + c * m[1][2]
        H_y[i, ELEVATION] = a * m[2][0] + b * m[2][1] + c * m[2][2]
        H_y[i, RHO] = a * offset[0] + b * offset[1] + c * offset[2]
    return True


@borrowing
def _chain(view: View, p_C: Vector, d: Vector, scale: float, H_x: np.ndarray, H_y: np.ndarray) -> None:
    """J = dz/dp_C R^T; H_y[:, :3] = scale J (by a world point), H_x = [-scale J, J [d]x]."""
    R_WC = view.R_WC
    pixel_jacobian(view.lens, p_C, H_y)  # dz/dp_C, for as long as it takes to turn it
    for i in range(2):
        a, b, c = H_y[i, 0], H_y[i, 1], H_y[i, 2]
        for j in range(3):
            value = a * R_WC[j, 0] + b * R_WC[j, 1] + c * R_WC[j, 2]
            H_y[i, j] = scale * value
            H_x[i, j] = -scale * value
        a, b, c = H_y[i, 0] / scale, H_y[i, 1] / scale, H_y[i, 2] / scale
        H_x[i, 3] = b * d[2] - c * d[1]
        H_x[i, 4] = c * d[0] - a * d[2]
        H_x[i, 5] = a * d[1] - b * d[0]


@borrowing
def own_innovation(
    lens: Record, P: np.ndarray, start: int, width: int, H_x: np.ndarray, H_y: np.ndarray, S: np.ndarray
) -> None:
    """S (2, 2) = H P H^T + R, with H non-zero on the pose and on ``width`` columns from ``start`` on; the lens's R."""
    s00, s01, s11 = lens.pixel_std**2, 0.0, lens.pixel_std**2
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


@borrowing
def curvature_of_inverse_depth(P: np.ndarray, rho: float, point: Record, D: np.ndarray) -> None:
    """Write the covariance of what the linearisation of an inverse depth neglects into ``point.curvature`` [px^2].

    It counts as noise: a filter that leaves out a product of two large errors is overconfident. Its mean is left out.
    ``D`` (3, 3) is room for a matrix. The point moves by d(rho) (anchor - p) + rho d(anchor - p)
    + d(rho) d(anchor - p). The last, a product of two errors that may both be large, has for Gaussians the covariance
    C = var(rho) D + c c^T, D = Cov(anchor - p), c = Cov(rho, anchor - p); in the image J C J^T, J = H_anchor / rho.
    """
    r, H_y = point.column + RHO, point.H_feature
    for i in range(3):
        a = point.column + i
        for j in range(3):
            b = point.column + j
            D[i, j] = P[r, r] * (P[a, b] - P[a, j] - P[i, b] + P[i, j]) + (P[r, a] - P[r, i]) * (P[r, b] - P[r, j])
    for i in range(2):
        for j in range(i + 1):
            value = 0.0
            for k in range(3):
                for m in range(3):
                    value += H_y[i, k] * D[k, m] * H_y[j, m]
            point.curvature[i, j] = value / (rho * rho)
            point.curvature[j, i] = point.curvature[i, j]


@borrowing
def visibility_of(lens: Record, z_hat: np.ndarray, S: np.ndarray) -> int:
    """Whether a predicted pixel with covariance ``S`` is out of reach (0), NEAR or INSIDE."""
    longest = math.sqrt(max(S[0, 0], S[1, 1]))
    if inside_image(lens, z_hat, -INSIDE_STDS * longest):
        return INSIDE
    return NEAR if inside_image(lens, z_hat, SEARCH_STDS * longest) else 0


@borrowing
def predict_pixel(view: View, belief: Belief, fiducials: np.ndarray, point: Record) -> bool:
    """Write pixel and Jacobians of a ``point`` of the belief at its present mean; False where it is not in front."""
    K, z, H_x, H_y = fiducials.shape[0], point.z_hat, point.H_camera, point.H_feature
    if point.row < K:
        seen = point_measurement(view, fiducials[point.row], z, H_x, H_y)
        for i in range(point.width):
            z[i] += belief.state.bias[2 * point.row + i]
            for j in range(point.width):
                H_y[i, j] = 1.0 if i == j else 0.0
        return seen
    feature = belief.feature[point.row - K]
    if feature.kind == POINT:
        return point_measurement(view, feature.mean, z, H_x, H_y)
    return inverse_depth_measurement(view, feature.mean, z, H_x, H_y)


@compiled
def sight_of_belief(lens: Record, belief: Belief, fiducials: np.ndarray, boxes: np.ndarray) -> Sight:
    """The fiducials (K, 3), and all features but rays, whose predicted pixel is within reach of the image.

    ``boxes`` (B, 2, 3) are those that the filter knows to occlude.
    """
    K, P, v = fiducials.shape[0], belief.covariance, 0
    view, points = view_of(lens, belief.state.camera, boxes), np.empty(K + belief.state.count, PREDICTED)
    S, D = np.empty((2, 2)), np.empty((3, 3))
    for row in range(K + belief.state.count):
        if row >= K and belief.feature[row - K].kind == RAY:
            continue
        vague = row >= K and belief.feature[row - K].kind != POINT
        point, y = points[v], _expected_place(belief, fiducials, row)
        _describe(belief, K, row, point)
        if in_field_of_view(view, y, lens.width, point.z_hat) and predict_pixel(view, belief, fiducials, point):
            own_innovation(lens, P, point.column, point.width, point.H_camera, point.H_feature, S)
            _write_noise(lens, point)
            if vague:
                curvature_of_inverse_depth(P, belief.feature[row - K].mean[RHO], point, D)
                for i in range(2):
                    for j in range(2):
                        S[i, j] += point.curvature[i, j]
            point.visibility = visibility_of(lens, point.z_hat, S)
            far = lens.maximum_distance  # beyond it, absence means nothing
            if far < math.inf and (vague or distance_between(view.pose, y) > TELLING_SHARE * far):
                point.visibility = min(point.visibility, NEAR)
            v += point.visibility > 0
    return sight_with(points[:v], P, belief.state.dim)


@borrowing
def _describe(belief: Belief, K: int, row: int, point: Record) -> None:
    """Write the identity of a fiducial or a feature, and its covariance rows."""
    point.row = row
    if row < K:
        biased = belief.state.bias_dim > 0
        point.column, point.width = (CAMERA_DIM + 2 * row, 2) if biased else (0, 0)
        point.id, point.unseen, point.crowded = fiducial_id(row), 0, NEVER
    else:
        feature = belief.feature[row - K]
        point.id, point.column, point.width = feature.id, feature.start, KIND_DIM[feature.kind]
        point.unseen = belief.state.frame - feature.seen if feature.seen > feature.born else NEVER
        point.crowded = belief.state.frame - feature.crowded


@borrowing
def _expected_place(belief: Belief, fiducials: np.ndarray, row: int) -> Direction:
    """The world point of a fiducial or a feature."""
    K = fiducials.shape[0]
    if row < K:
        return fiducials[row, 0], fiducials[row, 1], fiducials[row, 2]
    return place_of(belief.feature[row - K])


@borrowing
def _write_noise(lens: Record, point: Record) -> None:
    """R of the ``lens``, and no curvature."""
    for i in range(2):
        for j in range(2):
            point.R[i, j] = lens.pixel_std**2 if i == j else 0.0
            point.curvature[i, j] = 0.0


@compiled
def sight_of_points(
    lens: Record,
    boxes: np.ndarray,
    pose: np.ndarray,
    fiducials: np.ndarray,
    points: np.ndarray,
    seen: np.ndarray,
    P: np.ndarray,
) -> Sight:
    """The contents of the image from ``pose`` (>= 7: position, quaternion): the fiducials (K, 3) in it, and those of
    the ``seen`` (M,) points (M, 3).

    ``P`` (12 + 3 M, 12 + 3 M) is the joint covariance of camera and points.
    """
    K, view, v = fiducials.shape[0], view_of(lens, pose, boxes), 0
    found = np.empty(K + points.shape[0], PREDICTED)
    for row in range(K + points.shape[0]):
        if row >= K and not seen[row - K]:
            continue
        point, y = found[v], fiducials[row] if row < K else points[row - K]
        if visible(view, y, 0.0, point.z_hat) and point_measurement(
            view, y, point.z_hat, point.H_camera, point.H_feature
        ):
            point.row, point.id, point.visibility, point.unseen, point.crowded = row, 0, INSIDE, 0, NEVER
            point.column, point.width = (0, 0) if row < K else (CAMERA_DIM + 3 * (row - K), 3)
            _write_noise(lens, point)
            v += 1
    return sight_with(found[:v], P, P.shape[0])


@compiled
def sight_with(points: np.ndarray, P: np.ndarray, dim: int) -> Sight:
    """The joint covariances of ``points`` (v,): H P = H_camera P_camera + H_feature P_feature, S = H P H^T + R."""
    HP = np.zeros((2 * points.shape[0], dim))
    for a in range(points.shape[0]):
        point, rows = points[a], HP[2 * a : 2 * a + 2]
        add_product_of_two(point.H_camera, P[:POSE_DIM], rows)
        add_product_of_two(point.H_feature, P[point.column : point.column + point.width], rows)
    return Sight(points, HP, innovation_covariance(points, HP))


@compiled(fastmath={"contract"})
def innovation_covariance(points: np.ndarray, HP: np.ndarray) -> np.ndarray:
    """S (2 v, 2 v) of ``points`` (v,) from their ``HP``, see `Sight`; symmetric to the bit."""
    m = HP.shape[0]
    S = np.empty((m, m))
    for c in range(0, m, 2):  # both rows of a prediction's H at once
        point = points[c // 2]
        H_camera, H_feature, column = point.H_camera, point.H_feature, point.column
        for r in range(c + 2):
            row, u, v = HP[r], 0.0, 0.0
            for k in range(POSE_DIM):
                u += row[k] * H_camera[0, k]
                v += row[k] * H_camera[1, k]
            for k in range(point.width):
                u += row[column + k] * H_feature[0, k]
                v += row[column + k] * H_feature[1, k]
            S[r, c], S[c, r], S[r, c + 1], S[c + 1, r] = u, u, v, v
    for r in range(m):
        R, curvature = points[r // 2].R, points[r // 2].curvature
        for axis in range(2):
            S[r, r - r % 2 + axis] += R[r % 2, axis]
            S[r, r - r % 2 + axis] += curvature[r % 2, axis]
    return S
