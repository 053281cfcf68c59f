"""Candidate actions: where each would take the camera, what would be in view there, and what that would teach.

An action is a record (motion, gaze, frames); a plan is a sequence of actions. One kernel scores plans by any criterion,
and every score of an environment is made of it.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import change_of_view, distance_between, free_way, view_of, visible
from activeslam_gym.config import MOST_HELD_FRAMES
from activeslam_gym.geometry import rotate_left, rotation_matrix
from activeslam_gym.information.criteria import criterion_of_number
from activeslam_gym.information.entropy import WAITING, gathered, waiting_count
from activeslam_gym.kernels import Record, compiled, record
from activeslam_gym.linalg import cholesky_in_place, copy_block, copy_into, solve_transposed, subtract_symmetric
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    CAMERA_SIZE,
    GAZE_COUNT,
    MOTION_AXIS,
    MOTION_COUNT,
    MOTION_SIGN,
    POSITION,
    QUATERNION,
    Gaze,
    goal_of,
    open_loop,
    turn_of,
    turned_by,
)
from activeslam_gym.slam.estimate import EstimateArrays
from activeslam_gym.slam.kalman import propagate
from activeslam_gym.slam.sight import Sight, sight_of_points

ACTION = record(
    motion="i8",  # a `Motion`, or REMAIN
    gaze="i8",  # a `Gaze`, held all the time
    frames="i8",  # until the measurements are taken
)
"""A candidate action."""
REMAIN = -1  # in place of a motion: the present position, even where it is outside of what goals are clipped to
OPEN_LOOP = record(
    turn="f8",  # about the vertical [rad/s]
    frames="i8",  # 0: not filled yet
    noise=("f8", 2),  # deviations of the filter's accelerations
    F=("f8", (CAMERA_DIM, CAMERA_DIM)),
    Q=("f8", (CAMERA_DIM, CAMERA_DIM)),
)
"""An unobserved motion that plans share, and that is remembered from one decision to the next: `motion.open_loop`."""
MOST_OPEN_LOOPS = 2 * GAZE_COUNT
TURNING = ANGULAR_VELOCITY.start + 1  # where the rate about the vertical stands in a camera's mean


class SensorLimits(NamedTuple):
    """The limits of a sensor beside the image's border, occlusion and the greatest distance.

    The sensor `points` measures everything in view. The front end of `images` knows a feature by its appearance, so it
    measures none that it would see too differently; and it initialises features only while few are in view.
    """

    greatest_change: float
    """Of a feature's view since it was initialised, up to which it is measured [rad]."""
    wanted: int
    """Features and fiducials in view up to which new ones are initialised."""


UNLIMITED = SensorLimits(math.inf, 2**62)  # those of `points`


class PredictedBelief(NamedTuple):
    """What a policy plans with: the present estimate, and expected landmarks beside its features. M points.

    Nothing of it is predicted in time.
    """

    camera: np.ndarray
    """(13,) estimated camera."""
    points: np.ndarray
    """(M, 3) [m]."""
    covariance: np.ndarray
    """(12 + 3 M, 12 + 3 M)."""
    fiducials: np.ndarray
    """(K, 3) points of known position [m]."""
    boxes: np.ndarray
    """(B, 2, 3) what is known to occlude [m]."""
    waiting: int
    """How many of the points, the last ones, are expected landmarks."""
    clearance: np.ndarray = np.full(MOTION_COUNT, np.inf)
    """(7,) how far the camera can go in each motion's direction, as it is sensed where the camera stands [m]."""
    limits: SensorLimits = UNLIMITED
    """Those of the sensor."""
    first_seen: np.ndarray = np.zeros((0, 3))
    """(k, 3) where the camera was when each of the leading k points was initialised [m]; see `measurable_points`."""


@compiled
def predicted_belief_of(
    estimate: EstimateArrays,
    expected: np.ndarray,
    landmark_var: np.ndarray,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    clearance: np.ndarray,
    limits: SensorLimits,
    first_seen: np.ndarray,
) -> PredictedBelief:
    """The estimate without rays, and the waiting ones of ``expected`` (N,) with their variance (3,).

    ``first_seen`` (k, 3) is of all landmarks of the estimate, rays included, or k is 0.
    """
    located, waiting, n = np.empty(estimate.state.count, np.int64), waiting_count(expected), 0
    for k in range(located.shape[0]):
        located[n] = k
        n += estimate.landmark[k].located
    located, size = located[:n], CAMERA_DIM + 3 * (n + waiting)
    own_first_seen = first_seen[located[: first_seen.shape[0]]]
    points, P = np.empty((n + waiting, 3)), np.zeros((size, size))
    for k in range(n):
        copy_into(points[k], estimate.landmark[located[k]].point)
    copy_block(gathered(estimate.covariance, located[:0], located), P)
    for e in range(expected.shape[0]):
        if expected[e].feature == WAITING:
            copy_into(points[n], expected[e].point)
            for i in range(3):
                P[CAMERA_DIM + 3 * n + i, CAMERA_DIM + 3 * n + i] = landmark_var[i]
            n += 1
    return PredictedBelief(
        estimate.state.camera.copy(), points, P, fiducials, boxes, waiting, clearance, limits, own_first_seen
    )


@compiled
def goal_pose(
    motion: Record, belief: PredictedBelief, pose: np.ndarray, index: int, turn: float, frames: int
) -> np.ndarray:
    """The camera (13,) at the clipped goal of a motion (or REMAIN) from ``pose``, after ``frames`` frames of turning at
    ``turn`` [rad/s], as the rate loop makes it from the present rate; short of what is in the way.

    It is at rest but for that turning.
    """
    out = np.zeros(CAMERA_SIZE)
    turned, out[TURNING] = turned_by(motion, pose[TURNING], turn, frames)
    copy_into(out[POSITION], goal_of(motion, pose, index) if index != REMAIN else pose[POSITION])
    copy_into(out[QUATERNION], rotate_left(np.array((0.0, turned, 0.0)), pose[QUATERNION]))
    if motion.bodies:
        stop_short(motion, belief, pose, out)
    return out


@compiled
def propagate_by(motion: Record, P: np.ndarray, turn: float, frames: int, known: np.ndarray) -> None:
    """Make ``P`` the covariance after ``frames`` frames of turning at ``turn`` [rad/s] without a measurement.

    ``known`` (k,) OPEN_LOOP are looked up; one that is missing takes the first free place, or the last.
    """
    if frames == 0:
        return
    linear, angular = motion.filter_acceleration_std, motion.filter_angular_acceleration_std
    for k in range(known.shape[0]):
        one = known[k]
        found = one.frames == frames and one.turn == turn and one.noise[0] == linear and one.noise[1] == angular
        if found or one.frames == 0 or k == known.shape[0] - 1:
            if not found:
                F, Q = open_loop(motion, turn, frames)
                copy_block(F, one.F)
                copy_block(Q, one.Q)
                one.turn, one.frames, one.noise[0], one.noise[1] = turn, frames, linear, angular
            propagate(P, P.shape[0], one.F, one.Q)
            break


@compiled
def measurable_points(lens: Record, belief: PredictedBelief, pose: np.ndarray) -> np.ndarray:
    """(M,) bool: which of the points the sensor can measure from ``pose`` (13,), if they are in its image.

    The leading points are features; where ``first_seen`` is NaN, and where it is empty, every side will do. The others
    are expected landmarks: as many of those in view as there is room for beside the features in view, the first ones,
    since any may stand for another.
    """
    points, limits, first_seen = belief.points, belief.limits, belief.first_seen
    seen = np.ones(points.shape[0], np.bool_)
    if limits.greatest_change == math.inf:
        return seen
    room, z, view = limits.wanted, np.empty(2), view_of(lens, pose, belief.boxes)
    for fiducial in belief.fiducials:
        room -= visible(view, fiducial, 0.0, z)
    for i in range(points.shape[0]):
        if i < first_seen.shape[0]:
            seen[i] = not change_of_view(first_seen[i], pose, points[i]) > limits.greatest_change
            room -= seen[i] and visible(view, points[i], 0.0, z)
        elif visible(view, points[i], 0.0, z):
            seen[i] = room > 0
            room -= 1
    return seen


@compiled
def sight_after(lens: Record, belief: PredictedBelief, P: np.ndarray, pose: np.ndarray) -> Sight:
    """What is in view of ``pose`` (13,), with the covariance ``P``."""
    seen = measurable_points(lens, belief, pose)
    return sight_of_points(lens, belief.boxes, pose, belief.fiducials, belief.points, seen, P)


@compiled
def updated(P: np.ndarray, sight: Sight) -> np.ndarray:
    """The covariance after the measurements in ``sight``: P - W^T W with W = U^-T H P, U^T U = S."""
    out, U, W = P.copy(), sight.S.copy(), sight.HP.copy()
    if U.shape[0] > 0 and cholesky_in_place(U):
        solve_transposed(U, W)
        subtract_symmetric(out, W, W, P.shape[0])
    return out


@compiled
def score_plans(
    lens: Record,
    motion: Record,
    belief: PredictedBelief,
    time: float,
    plans: np.ndarray,
    criterion: int,
    known: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write into ``out`` (A,) what each of ``plans`` (A, L) of ACTION would teach, from ``time`` [s] on.

    ``known`` (k,) OPEN_LOOP, k > 0, are those of earlier decisions.

    By the chain rule I(x; z_1, z_2) = I(x; z_1) + I(x; z_2 | z_1): after each action but the last the covariance is
    updated by the measurements expected there, and propagated on. What consecutive plans have in common, the leading
    actions or the gaze and the frames of the last, is worked out once.
    """
    size, L = belief.covariance.shape[0], plans.shape[1]
    after, measured = np.empty((L, size, size)), np.empty((L - 1, size, size))  # covariances at each action's end
    poses, gained = np.empty((L + 1, CAMERA_SIZE)), np.zeros(L + 1)
    copy_into(poses[0], belief.camera)
    for a in range(plans.shape[0]):
        same, elapsed = a > 0, 0
        for step in range(L):
            action, last = plans[a, step], plans[max(a - 1, 0), step]
            turned = same and action.gaze == last.gaze and action.frames == last.frames
            same = turned and action.motion == last.motion
            if same and step < L - 1:
                elapsed += action.frames
                continue
            turn = turn_of(motion, action.gaze, time + elapsed * motion.dt)
            elapsed += action.frames
            if not turned:
                before = belief.covariance if step == 0 else measured[step - 1]
                copy_block(before, after[step])
                propagate_by(motion, after[step], turn, action.frames, known)
            pose = goal_pose(motion, belief, poses[step], action.motion, turn, action.frames)
            copy_into(poses[step + 1], pose)
            sight = sight_after(lens, belief, after[step], pose)
            taught = criterion_of_number(criterion, after[step], sight, lens.pixel_std**2)
            gained[step + 1] = gained[step] + taught
            if step < L - 1:
                copy_block(updated(after[step], sight), measured[step])
        out[a] = gained[L]


@compiled
def stop_short(motion: Record, belief: PredictedBelief, before: np.ndarray, after: np.ndarray) -> None:
    """Move the position of ``after`` back to where the camera can get from that of ``before``, both (>= 3,).

    The known boxes end the way from ``before``; the sensed clearances bound all positions of a plan, as a box in the
    axes of the present camera.
    """
    gap, length = motion.goal_margin - motion.wall_margin, distance_between(before, after)
    if length == 0.0:
        return
    way, R_WC, now = np.empty(3), rotation_matrix(belief.camera[QUATERNION]), belief.camera
    for i in range(3):
        way[i] = (after[i] - before[i]) * (1.0 + gap / length)
    share = (free_way(belief.boxes, motion.wall_margin, before, way) * (length + gap) - gap) / length
    for i in range(3):
        way[i] = before[i] + max(share, 0.0) * (after[i] - before[i]) - now[i]
        after[i] = now[i]
    for index in range(0, MOTION_COUNT - 1, 2):
        axis, sign, along = MOTION_AXIS[index], MOTION_SIGN[index], 0.0
        for i in range(3):
            along += R_WC[i, axis] * way[i]
        ahead, behind = max(belief.clearance[index] - gap, 0.0), max(belief.clearance[index + 1] - gap, 0.0)
        along = sign * min(max(sign * along, -behind), ahead)
        for i in range(3):
            after[i] += R_WC[i, axis] * along


@compiled
def unshown(lens: Record, belief: PredictedBelief) -> PredictedBelief:
    """The belief with NaN for the expected landmarks that the present image would show: nothing was found there."""
    now, boxes, points, z = belief.camera, belief.boxes, belief.points.copy(), np.empty(2)
    view = view_of(lens, now, boxes)
    for k in range(points.shape[0] - belief.waiting, points.shape[0]):
        if visible(view, points[k], 0.0, z):
            points[k] = np.nan
    given = belief.waiting, belief.clearance, belief.limits, belief.first_seen
    return PredictedBelief(now, points, belief.covariance, belief.fiducials, boxes, *given)


def without_present(lens: Record, belief: PredictedBelief, seen: np.ndarray | None = None) -> PredictedBelief:
    """The predicted belief without those landmarks.

    ``seen`` (M,) bool: which of the points another sensor than the ``lens`` shows now.
    """
    if seen is None:
        seen = np.isnan(unshown(lens, belief).points[:, 0]) & np.isfinite(belief.points[:, 0])
    features = len(belief.points) - belief.waiting
    kept = np.flatnonzero(~seen | (np.arange(len(seen)) < features))
    P, waiting = gathered(belief.covariance, kept[:0], kept), len(kept) - features
    return belief._replace(points=belief.points[kept], covariance=P, waiting=waiting)


def checked_plans(plans: Any) -> np.ndarray:
    """``plans`` as a contiguous array (A, L) of ACTION.

    Raises:
        ValueError: of another shape or type, or a motion, a gaze or a number of frames is none.
    """
    array = np.asarray(plans)
    if array.dtype != ACTION or array.ndim != 2 or array.shape[1] == 0:
        message = "plans must be an array (A, L) of activeslam_gym.information.candidates.ACTION (motion, gaze, frames)"
        raise ValueError(f"{message}: np.array([[(Motion.LEFT, Gaze.STAY, 20)]], ACTION), for example; got {plans!r}")
    least, limit = (REMAIN, 0, 0), (MOTION_COUNT, GAZE_COUNT, MOST_HELD_FRAMES + 1)
    for name, low, high in zip(ACTION.names or (), least, limit, strict=True):
        if not ((array[name] >= low) & (array[name] < high)).all():
            raise ValueError(f"{name} of plans must be in {low} … {high - 1}, got {array[name].tolist()}")
    return np.ascontiguousarray(array)


def _plans(motions: Any, gazes: Any, frames: int) -> np.ndarray:
    """Plans (A, L) of these motions and gazes, which are broadcast against each other, of ``frames`` frames each."""
    plans = np.zeros(np.broadcast(motions, gazes).shape, ACTION)
    plans["motion"], plans["gaze"], plans["frames"] = motions, gazes, frames
    return plans


def motion_plans(frames: int, gaze: int = Gaze.STAY) -> np.ndarray:
    """(7, 1): each motion, with ``gaze`` held."""
    return _plans(np.arange(MOTION_COUNT)[:, None], gaze, frames)


def gaze_plans(frames: int) -> np.ndarray:
    """(3, 1): each gaze, from the present position."""
    return _plans(REMAIN, np.arange(GAZE_COUNT)[:, None], frames)


def joint_plans(frames: int) -> np.ndarray:
    """(21, 1): each motion with each gaze, by gaze first: what a gaze does to the covariance is worked out once."""
    return np.concatenate([motion_plans(frames, gaze) for gaze in range(GAZE_COUNT)])


def sequence_plans(frames: int, horizon: int) -> np.ndarray:
    """(7^horizon, horizon): every sequence of motions, in order, gaze STAY."""
    motions = np.indices((MOTION_COUNT,) * horizon).reshape(horizon, -1).T
    return _plans(motions, Gaze.STAY, frames)


def held_plans(frames: int, count: int) -> np.ndarray:
    """(21, count): each motion with each gaze, held for ``count`` times ``frames`` frames; by gaze first."""
    return np.repeat(joint_plans(frames), count, axis=1)
