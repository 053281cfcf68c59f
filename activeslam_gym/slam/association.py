"""Data association: by certain ids, or joint and unambiguous inside chi-square gates.

The paper matches each measurement to the nearest predicted feature inside its ellipse. That swaps fiducials under the
prior's wide ellipses and takes wrong landmarks after a full turn, and one wrong match makes the next ones. So:

1. "Near" is by likelihood, cost = d^2 + ln |S|: plain Mahalanobis distance favours whatever is uncertain.
2. A sharp prediction is matched if it and the detection are each other's best and no rival inside the initialisation
   gate comes within a margin. The joint Gaussian of the other predicted pixels is conditioned on it (sequential
   compatibility nearest neighbour; Neira and Tardos, "Data association in stochastic mapping using the joint
   compatibility test", 2001).
3. The rest is matched jointly, by their branch and bound. They count pairs; here an assignment gives each prediction a
   detection or none, and its log likelihood against "all are of nothing known" is

       sum over pairs    ln N(z; z_hat, S | the pairs before) - ln(unmapped detections per px^2)
     + sum over others   ln(1 - P_D P(its pixel is in the image)).

   A pair is accepted when the best assignment leads all that answer otherwise for its prediction by a margin, a smaller
   one where it was seen lately: a feature that comes back does so beside unknown landmarks, by a pose that has drifted.
4. All else near a prediction, given all matches, waits for a clearer frame: it is neither a new feature nor a miss.
5. Two predictions side by side wait too: the noise decides between them, and would drive them apart in the map.
6. So does a feature by inverse depth while two detections that no other prediction explains are in its gate, and a
   moment longer: its ellipse is long, and takes the one for the other when that is missed.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants
from activeslam_gym.linalg import copy_block, copy_into, submatrix
from activeslam_gym.slam.belief import INVERSE_DEPTH, KIND_DIM, Belief
from activeslam_gym.slam.depth_particles import follow_rays
from activeslam_gym.slam.detection import (
    MISSED,
    NEW,
    REJECTED,
    UNASSOCIATED,
    WAITS,
    Hypotheses,
    accept,
    at_level,
    chi_square_2_quantile,
    condition_open,
    cost_of,
    hypotheses,
    log_missed,
    measure_distances,
    measure_from_start,
    predicted_pixels,
)
from activeslam_gym.slam.sight import Sight, pixel_rows

MOST_POINTS = 14  # a joint search takes so many predictions, the sharpest
UNDECIDED = -1  # in place of a prediction's detection in a search
ASSOCIATION, association_of = constants(
    Scenario(),
    gate=lambda s: chi_square_2_quantile(s.gate_probability),  # chi-square bound of a match
    new_feature_gate=lambda s: chi_square_2_quantile(s.new_feature_gate_probability),  # of what is near a prediction
    pixel_var=lambda s: s.pixel_std**2,  # R of a detection that is still to come, each axis [px^2]
    # a predicted ellipse, without R, is sharp when its longest axis squared is at most this [px^2]:
    sharp_var=lambda s: 3.0 * s.pixel_std**2,
    clear_margin=20.0,  # lead over its rivals that a match of a sharp row needs, in -2 ln of the likelihood
    margin=8.0,  # lead that a joint match needs over any other answer for its prediction, in ln
    lately_margin=5.0,  # and of a feature that was matched within so many frames:
    lately=lambda s: round(10.0 / s.frame_time),
    # nearer predictions are ambiguous [px]: with noise s they part by (d/s)^2 +- sqrt(2) d/s nats, at 4 s by 16 +- 6:
    twin_px=lambda s: 4.0 * s.pixel_std,
    crowded=lambda s: round(0.25 / s.frame_time),  # frames for which two detections in a feature's gate are remembered
    nodes=400,  # of a joint search
    detection_probability="f8",  # of what is in the image
    # -2 ln of the density of one unmapped detection in an image, less that of 2 pi:
    clutter_cost=lambda s: 2.0 * math.log(s.image_width * s.image_height / (2.0 * math.pi)),
    landmarks=lambda s: float(s.landmark_count),  # that the room holds
    clutter_rate="f8",  # false detections in an image
    image_size=lambda s: np.array((s.image_width, s.image_height), float),  # [px]
)
"""Constants of the association."""


@compiled
def associate(
    models: Record,
    belief: Belief,
    boxes: np.ndarray,
    sight: Sight,
    detections: np.ndarray,
    labelled: bool,
    counts: Record,
) -> np.ndarray:
    """Match ``detections`` (M,) to the predictions in ``sight`` (v,) and to rays; writes ``detections.match``.

    Returns (v,) the detection of each prediction, or MISSED, or WAITS. ``labelled``: the detections' ids are certain;
    one without an id is of nothing known. ``boxes`` are those that the filter knows to occlude.
    """
    if labelled:
        matches = match_by_id(sight, detections)
    else:
        matches = match_unknown(models.filter.association, sight, detections, belief.state.count)
    if belief.particles.shape[1] > 0:
        follow_rays(models.lens, models.filter, belief, boxes, detections, labelled)
    for one in detections:
        counts.rejected_matches += one.match == REJECTED
    return matches


@compiled
def match_by_id(sight: Sight, detections: np.ndarray) -> np.ndarray:
    """(v,) the likeliest detection that bears each prediction's id, or MISSED; ``detections.match`` are their ids."""
    matches = np.full(sight.point.shape[0], MISSED)
    for i, one in enumerate(detections):
        one.match = one.id if one.id != UNASSOCIATED else NEW
        for a in range(matches.shape[0]):
            rival = matches[a]
            if one.id == sight.point[a].id and (rival < 0 or one.log_ratio > detections[rival].log_ratio):
                matches[a] = i
    return matches


@compiled
def match_unknown(model: Record, sight: Sight, detections: np.ndarray, features: int) -> np.ndarray:
    """Match ``detections`` (M,) to the predictions in ``sight`` (v,) of a map with so many ``features``.

    Returns (v,) the detection of each prediction, or MISSED, or WAITS where a detection may be of it without being
    clear enough; sets ``detections.match``.
    """
    z, S = predicted_pixels(sight)
    h, matches, settled = hypotheses(sight.point, detections, z, S), np.full(sight.point.shape[0], MISSED), False
    # Detections of nothing known: an image sees about 15 % of a room, which may hold landmarks beside the features.
    unmapped = max(0.15 * (model.landmarks + 3.0 - features), 0.3) + model.clutter_rate
    pair_worth = 0.5 * model.clutter_cost - math.log(unmapped)
    while True:
        while _match_clear(model, h, matches):
            pass
        if settled:  # what a search of everything leaves open stays so
            break
        settled = match_jointly(model, h, pair_worth, matches)
    measure_from_start(h)
    _leave_unclear(model, h, matches)
    return matches


@compiled
def _leave_unclear(model: Record, h: Hypotheses, matches: np.ndarray) -> None:
    """Rules 4 to 6, by ``h`` given all ``matches`` (v,), which become WAITS; writes the ``match`` of the detections."""
    (v, M), points, detections = h.d2.shape, h.points, h.detections
    explained = np.zeros(M, np.bool_)
    detections["match"][:] = NEW
    for a in range(v):
        if matches[a] >= 0:
            detections[matches[a]].match, explained[matches[a]] = points[a].id, True
    for a in range(v):
        for i in range(M):
            if not explained[i] and h.d2[a, i] < model.new_feature_gate:
                detections[i].match = REJECTED
                matches[a] = matches[a] if matches[a] >= 0 else WAITS
    for a in range(v):
        for b in range(v):
            u, w = points[a].z_hat[0] - points[b].z_hat[0], points[a].z_hat[1] - points[b].z_hat[1]
            if b != a and u**2 + w**2 < model.twin_px**2:
                _wait(detections, explained, matches, a)
    for a in range(v):
        near = 0
        for i in range(M):
            near += h.d2[a, i] < model.gate and (not explained[i] or matches[a] == i)
        if near > 1 and points[a].width == KIND_DIM[INVERSE_DEPTH]:
            points[a].crowded = 0
        if points[a].crowded < model.crowded:
            _wait(detections, explained, matches, a)


@borrowing
def _wait(detections: np.ndarray, explained: np.ndarray, matches: np.ndarray, a: int) -> None:
    """Take the match of prediction ``a`` back, unless the detection has an id of its own."""
    i = matches[a]
    if i >= 0 and detections[i].id == UNASSOCIATED:
        detections[i].match, explained[i], matches[a] = REJECTED, False, WAITS


# Clear matches, one after the other -----------------------------------------------------------------------------------


@compiled
def _match_clear(model: Record, h: Hypotheses, matches: np.ndarray) -> bool:
    """Match every sharp prediction that has a clear partner, and condition the rest on them; whether there was any."""
    partner, found = np.full(matches.shape[0], -1), False
    for a in range(partner.shape[0]):
        s00, s01, s11 = h.S[2 * a, 2 * a], h.S[2 * a, 2 * a + 1], h.S[2 * a + 1, 2 * a + 1]
        half = 0.5 * (s00 + s11)
        longest_square = half + math.sqrt(max(half * half - (s00 * s11 - s01 * s01), 0.0))
        if matches[a] < 0 and longest_square <= model.sharp_var:
            partner[a] = _clear_partner(model, h, a)
            found |= partner[a] >= 0
    for a in range(partner.shape[0]):
        if partner[a] >= 0:
            matches[a] = partner[a]
            accept(h, a, partner[a], matches)
    if found:
        measure_distances(h)
    return found


@borrowing
def _clear_partner(model: Record, h: Hypotheses, a: int) -> int:
    """The detection that is the best of prediction ``a`` by a margin, as ``a`` is of the detection; or -1."""
    best, least = -1, math.inf
    for i in range(h.d2.shape[1]):
        if h.d2[a, i] < model.gate:
            cost = cost_of(h, a, i)
            if best < 0 or cost < least:
                best, least = i, cost
    if best < 0:
        return -1
    bound = least + model.clear_margin
    for i in range(h.d2.shape[1]):
        if i != best and h.d2[a, i] < model.new_feature_gate and cost_of(h, a, i) < bound:
            return -1
    for r in range(h.d2.shape[0]):
        if r != a and h.d2[r, best] < model.new_feature_gate and cost_of(h, r, best) < bound:
            return -1
    return best


# What is left, jointly ----------------------------------------------------------------------------------------------


class Search(NamedTuple):
    """A search of n predictions and M detections: what is asked, and the greatest scores that were found."""

    pair_worth: float  # log likelihood ratio of a pair against an unmapped detection, plus half of its cost
    most: float  # upper bound of the worth of any pair
    scores: np.ndarray  # (n, M + 1) greatest in which the prediction is the detection; in the last column, is missed
    best: np.ndarray  # (1,) greatest of all
    nodes: np.ndarray  # (1,) partial assignments so far
    answers: np.ndarray  # (n + 1, n) of each depth, the detection of each prediction, or M: missed, or UNDECIDED
    costs: np.ndarray  # (n + 1, M) of each depth, `cost_of` the detections near the prediction that is decided


@compiled
def match_jointly(model: Record, h: Hypotheses, pair_worth: float, matches: np.ndarray) -> bool:
    """Match the open predictions of ``h`` together, write ``matches`` (v,), and condition the rest on the matches.

    Returns whether another search can find no more: this one took all predictions in reach, or matched none. Its
    bound is of nodes, never of time: where they run out, the sharper half is searched, which sharpens the others.
    """
    (v, M), matched = h.d2.shape, 0
    spread = np.full(v, np.inf)  # tr S of the predictions in reach: with a detection inside the initialisation gate
    for a in range(v):
        for i in range(M):
            if h.d2[a, i] < model.new_feature_gate:
                spread[a] = h.S[2 * a, 2 * a] + h.S[2 * a + 1, 2 * a + 1]
    in_reach, chosen, a = 0, np.empty(v, np.int64), _least(spread)
    while a < v:
        chosen[in_reach], spread[a], in_reach = a, np.inf, in_reach + 1
        a = _least(spread)
    if in_reach == 0:
        return True
    scores = _search(model, h, chosen[: min(in_reach, MOST_POINTS)], pair_worth)
    for k in range(scores.shape[0]):
        a, answer, best, other = chosen[k], M, -np.inf, -np.inf
        for i in range(M + 1):
            other = max(other, min(best, scores[k, i]))
            if scores[k, i] > best:
                answer, best = i, scores[k, i]
        lately = h.points[a].id > 0 and h.points[a].unseen <= model.lately
        if answer < M and best - other >= (model.lately_margin if lately else model.margin):
            matches[a] = answer
            accept(h, a, answer, matches)
            matched += 1
    measure_distances(h)
    return matched == 0 or scores.shape[0] == in_reach


@borrowing
def _least(costs: np.ndarray) -> int:
    """The index of the least of the ``costs`` (n,), the first of equal ones, or n where none is finite."""
    best, least = costs.shape[0], np.inf
    for i in range(costs.shape[0]):
        if costs[i] < least:
            best, least = i, costs[i]
    return best


@compiled
def _search(model: Record, h: Hypotheses, chosen: np.ndarray, pair_worth: float) -> np.ndarray:
    """The greatest `Search.scores` of the ``chosen`` (n,) predictions; of fewer, or none, where the nodes run out."""
    n, M, rows, most = chosen.shape[0], h.detections.shape[0], pixel_rows(chosen), 0.0
    for one in h.detections:  # no prediction is sharper than the detection itself
        R = one.R
        most = max(most, pair_worth + one.log_ratio - 0.5 * math.log(R[0, 0] * R[1, 1] - R[0, 1] * R[0, 1]))
    scores, best, nodes = np.full((n, M + 1), -np.inf), np.full(1, -np.inf), np.zeros(1, np.int64)
    z, S, d2 = np.empty((n + 1, 2 * n)), np.empty((n + 1, 2 * n, 2 * n)), np.empty((n + 1, n, M))
    copy_into(z[0], h.z[rows])
    copy_block(submatrix(h.S, rows), S[0])
    copy_block(h.d2[chosen], d2[0])
    levels = Hypotheses(h.points, h.detections, z, S, d2)
    answers, costs = np.full((n + 1, n), UNDECIDED), np.empty((n + 1, M))
    _explore(model, levels, Search(pair_worth, most, scores, best, nodes, answers, costs), 0, 0, 0.0)
    if nodes[0] <= model.nodes:
        return scores
    return _search(model, h, chosen[: n // 2], pair_worth) if n > 2 else scores[:0]


@borrowing
def _explore(model: Record, levels: Hypotheses, search: Search, depth: int, matched: int, score: float) -> None:
    """Follow the assignments that begin with the answers and the ``score`` of this ``depth``, the likeliest first.

    Of the predictions that are UNDECIDED, that with the fewest detections in its gate is decided, and the others are
    conditioned on it. The last match was at the depth ``matched``: a miss changes no other prediction.
    """
    h, answer, (n, M) = at_level(levels, matched), search.answers[depth], levels.d2[0].shape
    decided, fewest, others, pairs = -1, M + 1, -1, 0
    for a in range(n):
        if answer[a] == UNDECIDED:
            near = 0
            for i in range(M):
                near += h.d2[a, i] < model.new_feature_gate
            if near == 0:
                answer[a], score = M, score + log_missed(model, h, a)
                continue
            others += 1
            if near < fewest:
                fewest, decided = near, a
    if decided < 0:
        for a in range(n):
            search.scores[a, answer[a]] = max(search.scores[a, answer[a]], score)
        search.best[0] = max(search.best[0], score)
        return
    costs = search.costs[depth]
    for i in range(M):
        costs[i], reached = np.inf, False
        for a in range(n):
            reached = reached or (answer[a] == UNDECIDED and h.d2[a, i] < model.new_feature_gate)
        pairs += reached
        if h.d2[decided, i] < model.new_feature_gate:
            costs[i] = cost_of(h, decided, i)
    rest = search.most * min(others, pairs)  # the others add at most so much
    for _ in range(fewest + 1):
        i = _least(costs)
        worth = log_missed(model, h, decided) if i == M else search.pair_worth - 0.5 * costs[i]
        if i < M:
            costs[i] = np.inf
        if score + worth + rest < search.best[0] - model.margin:
            continue
        search.nodes[0] += 1
        if search.nodes[0] > model.nodes:
            return
        deeper, last = search.answers[depth + 1], matched
        copy_into(deeper, answer)
        deeper[decided] = i
        if i < M and others > 0:
            last = depth + 1
            condition_open(h, at_level(levels, last), decided, i, deeper)
        _explore(model, levels, search, depth + 1, last, score + worth)
