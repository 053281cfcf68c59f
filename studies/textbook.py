"""The textbook's data associations, in place of `slam.association.associate`, whose arguments and answers they have.

Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test", 2001: mutual nearest
neighbours within gates (section II), and the joint compatibility branch and bound (JCBB, section III). For images, in
place of `slam.appearance.associate_identified`: Civera, Grasa, Davison and Montiel, "1-point RANSAC for EKF filtering",
2010.
"""

import numpy as np

from activeslam_gym.kernels import Record, compiled
from activeslam_gym.slam.association import NEW, REJECTED, UNASSOCIATED, condition, distance_and_det, predicted_pixels
from activeslam_gym.slam.sight import Sight

NODES = 2000  # after which the best hypothesis so far is taken
NORMAL_QUANTILE = 2.3263  # of 99 %
LOW_INNOVATION = 1.0  # distance from its prediction by one detection up to which another supports it [px]


@compiled
def chi_square(dof: float) -> float:
    """99 % quantile of the chi-square distribution, by Wilson and Hilferty's approximation."""
    h = 2.0 / (9.0 * dof)
    return dof * (1.0 - h + NORMAL_QUANTILE * np.sqrt(h)) ** 3


@compiled
def jcbb(model: Record, sight: Sight, detections: np.ndarray, features: int, waits: np.ndarray) -> np.ndarray:
    """The hypothesis of most pairings that are jointly compatible, of these the one of least joint distance."""
    v, M = sight.point.shape[0], detections.shape[0]
    z0, S0 = predicted_pixels(sight)
    allowed, of_point = np.zeros((v, M), np.bool_), np.full(v, -1)
    near, size = np.zeros((v, M), np.bool_), np.empty(v)
    for a in range(v):
        reached = 0
        for i in range(M):
            id = detections[i].id
            if id == UNASSOCIATED or id == sight.point[a].id:
                d2, det = distance_and_det(z0, S0, a, detections[i])
                allowed[a, i], near[a, i] = d2 < model.gate, d2 < model.new_feature_gate
                reached += allowed[a, i]
        size[a] = S0[2 * a, 2 * a] + S0[2 * a + 1, 2 * a + 1] if reached else np.inf
    order = np.argsort(size)
    n = 0
    while n < v and size[order[n]] < np.inf:
        n += 1
    z, S = np.empty((n + 1, 2 * v)), np.empty((n + 1, 2 * v, 2 * v))
    free, D2, pairs = np.ones((n + 1, M), np.bool_), np.zeros(n + 1), np.zeros(n + 1, np.int64)
    choice, cost = np.full((n + 1, M + 1), -1), np.empty(M + 1)
    choices, tried = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    answer, best, best_count, best_D2 = np.full(n, -1), np.full(n, -1), -1, np.inf
    z[0], S[0] = z0, S0
    depth, arrived, nodes = 0, True, 0
    while depth >= 0:
        if depth == n:
            if pairs[n] > best_count or (pairs[n] == best_count and D2[n] < best_D2):
                best_count, best_D2 = pairs[n], D2[n]
                best[:] = answer
            depth -= 1
            arrived = False
            continue
        a = order[depth]
        if arrived:
            m = 0
            for i in range(M):
                if free[depth, i] and allowed[a, i]:
                    d2, det = distance_and_det(z[depth], S[depth], a, detections[i])
                    if D2[depth] + d2 < chi_square(2.0 * (pairs[depth] + 1)):
                        k = m
                        while k > 0 and cost[k - 1] > d2:
                            cost[k], choice[depth, k] = cost[k - 1], choice[depth, k - 1]
                            k -= 1
                        cost[k], choice[depth, k] = d2, i
                        m += 1
            choice[depth, m] = -1
            choices[depth], tried[depth] = m + 1, 0
        arrived = False
        nodes += 1
        rest = n - depth
        if tried[depth] == choices[depth] or nodes > NODES or pairs[depth] + rest < best_count:
            depth -= 1
            continue
        i = choice[depth, tried[depth]]
        tried[depth] += 1
        gained = 1 if i >= 0 else 0
        if pairs[depth] + gained + rest - 1 < best_count:
            continue
        d2 = 0.0
        z[depth + 1], S[depth + 1], free[depth + 1] = z[depth], S[depth], free[depth]
        if i >= 0:
            d2, det = distance_and_det(z[depth], S[depth], a, detections[i])
            condition(z[depth + 1], S[depth + 1], a, detections[i])
            free[depth + 1, i] = False
        if pairs[depth] + gained + rest - 1 == best_count and D2[depth] + d2 >= best_D2:
            continue
        D2[depth + 1], pairs[depth + 1], answer[depth] = D2[depth] + d2, pairs[depth] + gained, i
        depth += 1
        arrived = True
    for d in range(n):
        of_point[order[d]] = best[d]
    _write_matches(sight, detections, of_point, near, waits)
    return of_point


@compiled
def nearest_neighbour(
    model: Record, sight: Sight, detections: np.ndarray, features: int, waits: np.ndarray
) -> np.ndarray:
    """Mutual nearest neighbours within the gates, by likelihood."""
    v, M = sight.point.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    of_point, near = np.full(v, -1), np.zeros((v, M), np.bool_)
    cost, best, rival = np.full((v, M), np.inf), np.full(v, -1), np.full(M, -1)
    for a in range(v):
        for i in range(M):
            id = detections[i].id
            if id == UNASSOCIATED or id == sight.point[a].id:
                d2, det = distance_and_det(z, S, a, detections[i])
                near[a, i] = d2 < model.new_feature_gate
                if d2 < model.gate:
                    cost[a, i] = d2 + np.log(det)
                    if best[a] < 0 or cost[a, i] < cost[a, best[a]]:
                        best[a] = i
                    if rival[i] < 0 or cost[a, i] < cost[rival[i], i]:
                        rival[i] = a
    for a in range(v):
        if best[a] >= 0 and rival[best[a]] == a:
            of_point[a] = best[a]
    _write_matches(sight, detections, of_point, near, waits)
    return of_point


@compiled
def _write_matches(
    sight: Sight, detections: np.ndarray, of_point: np.ndarray, near: np.ndarray, waits: np.ndarray
) -> None:
    """Set ``detections.match``: matched, REJECTED near a prediction (which ``waits`` if it has no match), or NEW."""
    for i in range(detections.shape[0]):
        detections[i].match = NEW
        for a in range(of_point.shape[0]):
            if near[a, i]:
                detections[i].match = REJECTED
    for a in range(of_point.shape[0]):
        if of_point[a] >= 0:
            detections[of_point[a]].match = sight.point[a].id
    for i in range(detections.shape[0]):
        for a in range(of_point.shape[0]):
            waits[a] |= detections[i].match == REJECTED and near[a, i] and of_point[a] < 0


@compiled
def one_point_ransac(model: Record, sight: Sight, detections: np.ndarray, least: int) -> np.ndarray:
    """The most detections within `LOW_INNOVATION` of the predictions that one of them determines; given these, each
    further one inside its gate. Every hypothesis is tried, so that nothing is left to chance."""
    v, M = sight.point.shape[0], detections.shape[0]
    z0, S0 = predicted_pixels(sight)
    of_detection, of_point, best, best_count = np.full(M, -1), np.full(v, -1), np.full(v, -1), 0
    for i in range(M):
        for a in range(v):
            if sight.point[a].id == detections[i].id:
                of_detection[i] = a
    for seed in range(M):
        a = of_detection[seed]
        if a < 0 or distance_and_det(z0, S0, a, detections[seed])[0] >= model.search_gate:
            continue
        z, S, nearest = z0.copy(), S0.copy(), np.full(v, LOW_INNOVATION)
        condition(z, S, a, detections[seed])
        of_point[:] = -1
        for i in range(M):
            b = of_detection[i]
            if b >= 0:
                apart = np.hypot(detections[i].pixel[0] - z[2 * b], detections[i].pixel[1] - z[2 * b + 1])
                if apart < nearest[b]:
                    nearest[b], of_point[b] = apart, i
        count = int(np.count_nonzero(of_point >= 0))
        if count > best_count:
            best_count = count
            best[:] = of_point
    others = best < 0
    for a in range(v):
        if best[a] >= 0:
            condition(z0, S0, a, detections[best[a]])
    nearest = np.full(v, model.gate)
    for i in range(M):
        a = of_detection[i]
        if a >= 0 and others[a]:
            d2, det = distance_and_det(z0, S0, a, detections[i])
            if d2 < nearest[a]:
                nearest[a], best[a] = d2, i
    if np.count_nonzero(best >= 0) < least:
        best[:] = -1
    for i in range(M):
        a = of_detection[i]
        detections[i].match = detections[i].id if a >= 0 and best[a] == i else REJECTED
    return best
