"""Scores with a foreign sensor or by a foreign criterion: the loop of `candidates.score_plans` in Python.

Each measurement of a foreign sensor is whitened to the variance of the image noise, so that every criterion holds
for any number of values a measurement and for any noise.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from activeslam_gym.information.candidates import (
    MOST_OPEN_LOOPS,
    OPEN_LOOP,
    PredictedBelief,
    goal_pose,
    propagate_by,
    updated,
)
from activeslam_gym.information.criteria import CRITERIA, Criterion
from activeslam_gym.kernels import Record
from activeslam_gym.linalg import cholesky_in_place, log2_det
from activeslam_gym.motion import CAMERA_DIM, POSITION, turn_of
from activeslam_gym.registry import array_of, name_of, number_from, part_of
from activeslam_gym.slam.sight import INSIDE, PREDICTED, Sight, sight_with


def score_plans_with(
    look: Callable[[np.ndarray, np.ndarray], Sight],
    motion: Record,
    belief: PredictedBelief,
    time: float,
    plans: np.ndarray,
    criterion: str | Criterion,
    pixel_var: float,
    frames: int,
) -> np.ndarray:
    """(2, A) scores of each of ``plans`` (A, L) of ACTION by the ``criterion``, and `Forecast.position_std` [m].

    ``look`` (P, pose) predicts the measurements. By ``net_information`` they are taken once for each frame of an
    action, the entropy that motions add is taken off, and plans end after ``frames`` frames. Where their covariance S
    is not positive definite, or P not finite, the score is NaN. Expected landmarks make the position no surer.
    """
    (out, position_std), net = np.zeros((2, len(plans))), criterion == "net_information"
    function, known = part_of("criterion", criterion, CRITERIA), np.zeros(MOST_OPEN_LOOPS, OPEN_LOOP)
    size = CAMERA_DIM + 3 * (len(belief.points) - belief.waiting)
    for a, plan in enumerate(plans):
        P, pose, elapsed = belief.covariance, belief.camera, 0
        C = P[:size, :size].copy()  # of the camera and the features
        for action in plan:
            if net and elapsed >= frames:
                break
            turn = turn_of(motion, int(action["gaze"]), time + elapsed * float(motion.dt))
            taken = min(int(action["frames"]), frames - elapsed) if net else int(action["frames"])
            before, P = P, P.copy()
            propagate_by(motion, P, turn, taken, known)
            if net:
                propagate_by(motion, C, turn, taken, known)
                position_std[a] = max(position_std[a], math.sqrt(max(np.trace(C[POSITION, POSITION]), 0.0)))
                out[a] -= 0.5 * (log2_det(P) - log2_det(before))
            pose, elapsed = goal_pose(motion, belief, pose, int(action["motion"]), turn, taken), elapsed + taken
            sight, var = look(P, pose), pixel_var
            if net:  # as often as there are frames
                var = pixel_var / max(taken, 1)
                sight.S[np.diag_indices_from(sight.S)] += var - pixel_var
                own = sight_with(sight.point[sight.point["column"] < size], C, size)
                own.S[np.diag_indices_from(own.S)] += var - pixel_var
                C = updated(C, own)
            before, P = P, updated(P, sight)
            if np.isfinite(before).all() and (not len(sight.S) or cholesky_in_place(sight.S.copy())):
                where = f"for (motion, gaze, frames) {(*action.tolist()[:2], taken)} of plan {a}"
                given = before, sight, var
                out[a] += number_from(f"criterion {name_of(criterion)!r}", function, *given, where=where)
            else:
                out[a] = np.nan
    return np.stack((out, position_std))


def sight_by(sensor: Any, belief: PredictedBelief, pixel_var: float, P: np.ndarray, pose: np.ndarray) -> Sight:
    """The measurements that the ``sensor`` predicts from ``pose`` (13,), each as rows in pairs."""
    K, places = len(belief.fiducials), np.concatenate((belief.fiducials, belief.points))
    seen = np.flatnonzero(array_of("visible()", sensor.visible(pose, places), (len(places),), bool)).tolist()
    whitening = np.sqrt(pixel_var) * np.linalg.inv(np.linalg.cholesky(sensor.noise))
    pairs = (len(sensor.noise) + 1) // 2
    points = np.zeros(pairs * len(seen), PREDICTED)
    for a, row in enumerate(seen):
        _, H_x, H_y = sensor.predict(pose, places[row])
        for H, field, width in ((H_x, "H_camera", 6), (H_y, "H_feature", 3)):
            rows = np.zeros((2 * pairs, 6))
            rows[: len(whitening), :width] = whitening @ array_of("a Jacobian", H, (len(whitening), width))
            points[field][pairs * a : pairs * (a + 1)] = rows.reshape(pairs, 2, 6)
        own = points[pairs * a : pairs * (a + 1)]
        own["row"], own["visibility"] = row, INSIDE
        own["column"], own["width"] = (CAMERA_DIM + 3 * (row - K), 3) if row >= K else (0, 0)
    points["R"] = pixel_var * np.eye(2)
    return sight_with(points, P, len(P))
