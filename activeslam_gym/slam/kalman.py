"""The Kalman filter of the mean and the joint covariance, cross-covariances included: prediction and update.

The update by all that was matched is iterated where the measurement is not linear enough. The mean is on a manifold:
`shift_mean` moves it, and `update_covariance` gives the covariance about the new mean. The estimator `ekf` is the
right-invariant filter. `ekf-plain` keeps the tangent as it is, and so gains orientation that it never measured.
"""

import math

import numpy as np

from activeslam_gym.camera import view_of
from activeslam_gym.geometry import rotate_left, so3_left_jacobian, write_skew
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import (
    add_product,
    add_symmetric_product,
    cholesky_in_place,
    copy_block,
    copy_into,
    diagonal,
    solve_transposed,
    solve_transposed_vector,
    submatrix,
    subtract_from_upper,
    subtract_symmetric,
)
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    D_ANGULAR,
    D_POSITION,
    D_ROTATION,
    D_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
    process_covariance,
    transition,
    transition_jacobian,
)
from activeslam_gym.slam.belief import AZIMUTH, ELEVATION, INVERSE_DEPTH, KIND_DIM, PLAIN, POINT, RHO, Belief
from activeslam_gym.slam.detection import REJECTED
from activeslam_gym.slam.restart import contradicted, restart
from activeslam_gym.slam.sight import POSE_DIM, PRODUCT_FRAMES, Sight, pixel_rows, predict_pixel, sight_with

ITERATIONS = 3  # at most so many after the first update
NONLINEARITY_PX = 0.3  # an update is iterated where a pixel at the new mean is farther from its linear prediction
MINIMUM_INVERSE_DEPTH = 0.01  # updates keep inverse depths above this [1/m]


@compiled
def predict(motion: Record, belief: Belief, u: np.ndarray, dt: float, contact: bool) -> None:
    """``dt`` seconds ahead under the known accelerations ``u`` (6,): x = f(x, u), P = F P F^T + Q in the camera's rows.

    The appendix's prediction, and section II's. ``contact``: the camera has struck something in this frame.
    """
    if contact:
        update_contact(belief, u, dt)
    x = transition(belief.state.camera, u, dt)
    F_x = transition_jacobian(x[ANGULAR_VELOCITY], dt)
    copy_into(belief.state.camera, x)
    propagate(belief.covariance, belief.state.dim, F_x, process_covariance(motion, F_x, dt))
    belief.state.frame += 1


@borrowing
def update_contact(belief: Belief, u: np.ndarray, dt: float) -> None:
    """Where the camera strikes something, any part of its speed may be gone.

    So the variance of each axis' velocity grows by the square of what it would be.
    """
    for i in range(3):
        v = belief.state.camera[VELOCITY.start + i] + dt * u[i]
        row = D_VELOCITY.start + i
        belief.covariance[row, row] += v * v


@compiled
def propagate(P: np.ndarray, dim: int, F: np.ndarray, Q: np.ndarray) -> None:
    """P_cc = F P_cc F^T + Q and P_cy = F P_cy on the leading ``dim`` rows of ``P``, for any camera transition."""
    FP, P_cc = np.zeros((CAMERA_DIM, dim)), P[:CAMERA_DIM, :CAMERA_DIM]
    add_product(F, P[:CAMERA_DIM], FP)
    for i in range(CAMERA_DIM):
        for j in range(CAMERA_DIM, dim):
            P[i, j] = FP[i, j]
            P[j, i] = FP[i, j]
    copy_block(Q, P_cc)
    add_symmetric_product(FP, F, P_cc)


@compiled
def factored_gain(HP: np.ndarray, S: np.ndarray, innovation: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """(W, delta, sound): with U^T U = S and W = U^-T H P, K S K^T = W^T W and delta = K nu = W^T (U^-T nu).

    One factor, no inverse. ``HP`` (m, dim), which W overwrites, ``S`` = H P H^T + R (m, m) and ``innovation`` nu (m,)
    are overwritten. Not sound if S has no factor.
    """
    W, delta = HP, np.zeros((1, HP.shape[1]))
    if not cholesky_in_place(S):
        return W, delta[0], False
    solve_transposed(S, W)
    solve_transposed_vector(S, innovation)
    add_product(innovation[None, :], W, delta)
    sound = True
    for value in delta[0]:
        sound = sound and math.isfinite(value)
    return W, delta[0], sound


# The update -----------------------------------------------------------------------------------------------------------


@compiled
def update(
    models: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    matches: np.ndarray,
    detections: np.ndarray,
    counts: Record,
) -> None:
    """Correct the belief by the detections that ``matches`` (v,) gives to the predictions in ``sight``.

    Where the fiducials contradict the belief, it is reset instead, and no detection is used.
    """
    if contradicted(models.filter.restart, belief, sight, detections, matches):
        counts.deletions += belief.state.count
        counts.restarts += 1
        restart(models.filter.restart, belief)
        detections["match"][:] = REJECTED
    else:
        lasts = models.lens.command_known or fiducials.shape[0] > 0
        update_by(models.lens, belief, fiducials, sight, matches, detections, PRODUCT_FRAMES if lasts else 1.0)


@compiled
def update_by(
    lens: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    matches: np.ndarray,
    detections: np.ndarray,
    frames: float,
) -> None:
    """Correct by the matched predictions, each with the R of its own detection.

    So many ``frames`` tell of the curvature of a feature what one does (see `PRODUCT_FRAMES`), so each is given as many
    times that noise.
    """
    matched, count = np.empty(matches.shape[0], np.int64), 0
    for a in range(matches.shape[0]):
        if matches[a] >= 0:
            matched[count] = a
            count += 1
    if count == 0:
        return
    matched = matched[:count]
    rows = pixel_rows(matched)
    points, HP, S = sight.point[matched], np.empty((rows.shape[0], sight.HP.shape[1])), submatrix(sight.S, rows)
    more_frames, pixels = frames - 1.0, np.empty(rows.shape[0])
    for r in range(rows.shape[0]):
        point, detection, i = points[r // 2], detections[matches[matched[r // 2]]], r % 2
        copy_into(HP[r], sight.HP[rows[r]])
        pixels[r] = detection.pixel[i]
        for axis in range(2):
            more = more_frames * point.curvature[i, axis]
            S[r, r - i + axis] += detection.R[i, axis] - point.R[i, axis] + more
            point.R[i, axis] = detection.R[i, axis]
            point.curvature[i, axis] += more
    correct(lens, belief, fiducials, Sight(points, HP, S), pixels)


@compiled
def correct(lens: Record, belief: Belief, fiducials: np.ndarray, sight: Sight, pixels: np.ndarray) -> bool:
    """x ⊞ delta, P - W^T W by the ``pixels`` (2 m,) of the m predictions in ``sight``, which is overwritten.

    The iterated Kalman filter (Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", 1993):
    delta = K (z - h(x_i) + H_i delta_i) with H_i, and so K and W, taken at the last mean x_i = x ⊞ delta_i. False, with
    nothing changed, if S has no factor.
    """
    points, HP, S, state, shifted = sight.point, sight.HP, sight.S, belief.state, False
    camera, bias, features = state.camera.copy(), state.bias.copy(), belief.feature[: state.count].copy()
    line = np.empty(pixels.shape[0])  # the pixels at delta = 0, by the line through the last mean
    for r in range(line.shape[0]):
        line[r] = points[r // 2].z_hat[r % 2]
    W, delta, sound = factored_gain(HP, S, pixels - line)
    for _ in range(ITERATIONS if sound else 0):
        shift_mean(belief, delta)
        shifted = not _nonlinearity(lens, belief, fiducials, points, line, delta) > NONLINEARITY_PX
        if shifted:
            break
        _refer_to_prior(belief, points, line, delta)
        copy_into(state.camera, camera)
        copy_into(state.bias, bias)
        for k in range(state.count):
            belief.feature[k] = features[k]
        nearer = sight_with(points, belief.covariance, belief.state.dim)
        W_next, delta_next, next_sound = factored_gain(nearer.HP, nearer.S, pixels - line)
        if not next_sound:
            break
        W, delta = W_next, delta_next
    if sound:
        if not shifted:
            shift_mean(belief, delta)
        update_covariance(belief, W, delta)
    return sound


@compiled
def _nonlinearity(
    lens: Record, belief: Belief, fiducials: np.ndarray, points: np.ndarray, line: np.ndarray, delta: np.ndarray
) -> float:
    """Measure ``points`` at the shifted mean: how far their pixels are from ``line`` + H delta [px].

    Not at all, where one is not in front: there is no line to go on by.
    """
    pose, bent = belief.state.camera, 0.0
    view = view_of(lens, pose, np.empty((0, 2, 3)))
    for a in range(points.shape[0]):
        point = points[a]
        said = (line[2 * a] + _along(point, 0, delta), line[2 * a + 1] + _along(point, 1, delta))
        if not predict_pixel(view, belief, fiducials, point):
            return 0.0
        bent = max(bent, max(abs(point.z_hat[0] - said[0]), abs(point.z_hat[1] - said[1])))
    return bent


@borrowing
def _along(point: Record, axis: int, delta: np.ndarray) -> float:
    """H delta of one of a prediction's two rows."""
    total = 0.0
    for i in range(POSE_DIM):
        total += point.H_camera[axis, i] * delta[i]
    for i in range(point.width):
        total += point.H_feature[axis, i] * delta[point.column + i]
    return total


@compiled
def _refer_to_prior(belief: Belief, points: np.ndarray, line: np.ndarray, delta: np.ndarray) -> None:
    """H at the shifted mean, by the tangent that P is of: H M, with the rotation's columns of `update_covariance`.

    Then the new line is h(x_i) - H delta.
    """
    E, J = invariance_correction(belief, delta), left_jacobian(belief, delta)
    for a in range(points.shape[0]):
        point = points[a]
        for axis in range(2):
            h, y = point.H_camera[axis], point.H_feature[axis]
            turn = np.zeros(3)
            for k in range(3):
                for i in range(3):
                    turn[k] += h[3 + i] * J[i, k] + h[i] * E[k, i]
                for i in range(point.width):
                    turn[k] += y[i] * E[k, point.column + i]
            copy_into(h[D_ROTATION], turn)
            line[2 * a + axis] = point.z_hat[axis] - _along(point, axis, delta)


# The mean and its tangent ---------------------------------------------------------------------------------------------


@compiled
def shift_mean(belief: Belief, delta: np.ndarray) -> None:
    """mean ⊞ ``delta`` (dim,): the camera's rotation is perturbed on the left, in the world frame."""
    x = belief.state.camera
    _add(x[POSITION], delta[D_POSITION])
    _add(x[VELOCITY], delta[D_VELOCITY])
    _add(x[ANGULAR_VELOCITY], delta[D_ANGULAR])
    copy_into(x[QUATERNION], rotate_left(delta[D_ROTATION], x[QUATERNION]))
    _add(belief.state.bias, delta[CAMERA_DIM : CAMERA_DIM + belief.state.bias_dim])
    for k in range(belief.state.count):
        feature = belief.feature[k]
        _add(feature.mean, delta[feature.start : feature.start + KIND_DIM[feature.kind]])
        if feature.kind == INVERSE_DEPTH:
            feature.mean[RHO] = max(feature.mean[RHO], MINIMUM_INVERSE_DEPTH)


@borrowing
def _add(x: np.ndarray, delta: np.ndarray) -> None:
    for i in range(delta.shape[0]):
        x[i] += delta[i]


@compiled
def update_covariance(belief: Belief, W: np.ndarray, delta: np.ndarray) -> None:
    """M (P - W^T W) M^T: the update's covariance in the tangent of the mean just shifted by ``delta`` (dim,).

    M keeps what no bearing can tell, a turn of camera and map together, what it is. Such a turn a moves a point f by
    a x f; before the shift that is a x f, and after it has to be a x (f + df), so every world vector gets
    + dtheta x df. With the plain tangent (M = I) the direction would change with the estimate, and the filter would
    gain orientation that it never measured. It is the covariance of the right-invariant filter in these coordinates
    (Barrau and Bonnabel, *An EKF-SLAM algorithm with consistency properties*, 2015). The rotation's own rows follow
    from Exp(dtheta) = Exp(dtheta+) Exp(delta_theta), dtheta+ = J_l(delta_theta) (dtheta - delta_theta): the modern form
    of the paper's Jacobian of the quaternion's normalisation.

    With M = I + E^T on the rotation's columns, E (3, dim), and B = P_theta + P_theta,theta E / 2 of the P after the
    update, M P M^T = P + E^T B + B^T E: less (-E, -B)^T (B, E).
    """
    P, dim = belief.covariance, belief.state.dim
    subtract_from_upper(P, W, W, dim)
    E, left, right = invariance_correction(belief, delta), np.empty((6, dim)), np.empty((6, dim))
    B = right[:3]
    for i in range(3):
        row = D_ROTATION.start + i
        for j in range(dim):
            B[i, j] = P[row, j] if j >= row else P[j, row]
    add_product(0.5 * B[:, D_ROTATION], E, B)
    copy_block(E, right[3:])
    for i in range(3):
        for j in range(dim):
            left[i, j], left[3 + i, j] = -E[i, j], -B[i, j]
    subtract_symmetric(P, left, right, dim)
    J, P_theta = left_jacobian(belief, delta), np.zeros((3, dim))
    add_product(J, P[D_ROTATION], P_theta)
    for i in range(3):
        for j in range(dim):
            P[D_ROTATION.start + i, j] = P_theta[i, j]
            P[j, D_ROTATION.start + i] = P_theta[i, j]
    P[D_ROTATION, D_ROTATION] = 0.0
    add_symmetric_product(P_theta[:, D_ROTATION].copy(), J, P[D_ROTATION, D_ROTATION])


@compiled
def invariance_correction(belief: Belief, delta: np.ndarray) -> np.ndarray:
    """E (3, dim), M = I + E^T on the rotation's columns: how the shift changed what a turn does to each coordinate.

    Of a world vector that is shifted by d it is [d]x: a x d = E^T a.
    """
    E = np.zeros((3, belief.state.dim))
    if belief.state.variant == PLAIN:
        return E
    for at in (D_POSITION.start, D_VELOCITY.start, D_ANGULAR.start):
        write_skew(delta[at : at + 3], E, at)
    for k in range(belief.state.count):
        feature = belief.feature[k]
        at = feature.start
        write_skew(delta[at : at + 3], E, at)
        if feature.kind != POINT:
            azimuth, elevation = feature.mean[AZIMUTH], feature.mean[ELEVATION]
            angles = E[:, at + AZIMUTH : at + AZIMUTH + 2]
            _turn_angles(azimuth, elevation, 1.0, angles)
            _turn_angles(azimuth - delta[at + AZIMUTH], elevation - delta[at + ELEVATION], -1.0, angles)
    return E


@borrowing
def _turn_angles(azimuth: float, elevation: float, sign: float, E: np.ndarray) -> None:
    """Add ``sign`` times d(azimuth, elevation) of a direction by a turn of the world, the derivative of a x m."""
    sin_a, cos_a, tan_e = math.sin(azimuth), math.cos(azimuth), math.tan(elevation)
    E[0, 0] -= sign * tan_e * sin_a
    E[1, 0] += sign
    E[2, 0] -= sign * tan_e * cos_a
    E[0, 1] -= sign * cos_a
    E[2, 1] += sign * sin_a


@compiled
def left_jacobian(belief: Belief, delta: np.ndarray) -> np.ndarray:
    """J_l (3, 3), M on the rotation's own rows and columns."""
    return diagonal(np.ones(3)) if belief.state.variant == PLAIN else so3_left_jacobian(delta[D_ROTATION])
