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
from activeslam_gym.linalg import copy_into, submatrix
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
    chi_square_2_quantile,
    hypotheses,
    measure_distances,
    predicted_pixels,
)
from activeslam_gym.slam.sight import Sight, pixel_rows

MOST_POINTS = 14  # a joint search takes so many predictions, the sharpest
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
    twin_px=lambda s: 4.0 * s.pixel_std,  # predictions nearer to each other are ambiguous [px]
    crowded=lambda s: round(0.25 / s.frame_time),  # frames for which two detections in a feature's gate are remembered
    nodes=400,  # of a joint search
    detection_probability="f8",  # of what is in the image
    # -2 ln of the density of one unmapped detection in an image, less that of 2 pi:
    clutter_cost=lambda s: 2.0 * math.log(s.image_width * s.image_height / (2.0 * math.pi)),
    landmarks=lambda s: float(s.landmark_count),  # that the room holds
    clutter_rate="f8",  # false detections in an image
    width=lambda s: float(s.image_width),  # of the image [px]
    height=lambda s: float(s.image_height),
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
        follow_rays(models.lens, models.filter.particles, belief, boxes, detections, labelled)
    for one in detections:
        counts.rejected_matches += one.match == REJECTED
    return matches


@compiled
def match_by_id(sight: Sight, detections: np.ndarray) -> np.ndarray:
    """(v,) the likeliest detection that bears each prediction's id, or MISSED; ``detections.match`` are their ids."""
    matches = np.full(sight.point.shape[0], MISSED)
    for i in range(detections.shape[0]):
        detections[i].match = detections[i].id if detections[i].id != UNASSOCIATED else NEW
        for a in range(matches.shape[0]):
            rival = matches[a]
            if detections[i].id == sight.point[a].id and (
                rival < 0 or detections[i].log_ratio > detections[rival].log_ratio
            ):
                matches[a] = i
    return matches


@compiled
def match_unknown(model: Record, sight: Sight, detections: np.ndarray, features: int) -> np.ndarray:
    """Match ``detections`` (M,) to the predictions in ``sight`` (v,) of a map with so many ``features``.

    Returns (v,) the detection of each prediction, or MISSED, or WAITS where a detection may be of it without being
    clear enough; sets ``detections.match``.
    """
    points, v, M = sight.point, sight.point.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    h, matches, settled = hypotheses(points, z, S, detections), np.full(v, MISSED), False
    pair_worth = 0.5 * model.clutter_cost - math.log(expected_unmapped(model, features))
    while True:
        while _match_clear(model, h, detections, matches):
            pass
        if settled:  # what a search of everything leaves open stays so
            break
        settled = match_jointly(model, h, points, detections, pair_worth, matches)
    h, free = hypotheses(points, z, S, detections), np.ones(M, np.bool_)  # given all matches
    for a in range(v):
        if matches[a] >= 0:
            free[matches[a]] = False
    for i in range(M):
        detections[i].match = NEW
        for a in range(v):
            if free[i] and h.d2[a, i] < model.new_feature_gate:
                detections[i].match = REJECTED
                matches[a] = matches[a] if matches[a] >= 0 else WAITS
    for a in range(v):
        i = matches[a]
        if i >= 0 and detections[i].id == UNASSOCIATED and _has_twin(model, points, a):
            detections[i].match, matches[a] = REJECTED, WAITS
        elif i >= 0:
            detections[i].match = points[a].id
    for a in range(v):
        i, point = matches[a], points[a]
        if point.width == KIND_DIM[INVERSE_DEPTH] and _is_crowded(model, h, a, detections, point.id):
            point.crowded = 0
        if i >= 0 and detections[i].id == UNASSOCIATED and point.crowded < model.crowded:
            detections[i].match, matches[a] = REJECTED, WAITS
    return matches


@borrowing
def _has_twin(model: Record, points: np.ndarray, a: int) -> bool:
    """Whether another of the ``points`` (v,) is predicted beside prediction ``a``.

    Two that are d apart are told apart by (d / s)^2 +- sqrt(2) d / s nats, s the deviation of a pixel: at d = 4 s by
    16 +- 6, so that hardly a match that is clear enough owes it to its noise.
    """
    z = points[a].z_hat
    for b in range(points.shape[0]):
        other = points[b].z_hat
        if b != a and (z[0] - other[0]) ** 2 + (z[1] - other[1]) ** 2 < model.twin_px**2:
            return True
    return False


@borrowing
def _is_crowded(model: Record, h: Hypotheses, a: int, detections: np.ndarray, id: int) -> bool:
    """Whether two detections that no other prediction explains are in the gate of prediction ``a``, of that ``id``."""
    near = 0
    for i in range(detections.shape[0]):
        match = detections[i].match
        near += h.d2[a, i] < model.gate and (match == NEW or match == REJECTED or match == id)
    return near > 1


@compiled
def expected_unmapped(model: Record, features: int) -> float:
    """Detections of nothing known that are expected in an image, of landmarks that are still owed and of clutter.

    An image sees about 15 % of a room; some landmarks may be owed although there is a feature for each.
    """
    return max(0.15 * (model.landmarks + 3.0 - features), 0.3) + model.clutter_rate


# Clear matches, one after the other -----------------------------------------------------------------------------------


@compiled
def _match_clear(model: Record, h: Hypotheses, detections: np.ndarray, matches: np.ndarray) -> bool:
    """Match every sharp prediction that has a clear partner, and condition the rest on them; whether there was any."""
    partner, found = np.full(matches.shape[0], -1), False
    for a in range(partner.shape[0]):
        if matches[a] < 0 and _longest_square(h.S, a) <= model.sharp_var:
            partner[a] = _clear_partner(model, h, a)
            found |= partner[a] >= 0
    for a in range(partner.shape[0]):
        if partner[a] >= 0:
            matches[a] = partner[a]
            accept(h, a, partner[a], detections)
    if found:
        measure_distances(h, detections)
    return found


@borrowing
def _clear_partner(model: Record, h: Hypotheses, a: int) -> int:
    """The detection that is the best of prediction ``a`` by a margin, as ``a`` is of the detection; or -1."""
    best = -1
    for i in range(h.d2.shape[1]):
        if h.d2[a, i] < model.gate and (best < 0 or h.cost[a, i] < h.cost[a, best]):
            best = i
    if best < 0:
        return -1
    bound = h.cost[a, best] + model.clear_margin
    for i in range(h.d2.shape[1]):
        if i != best and h.d2[a, i] < model.new_feature_gate and h.cost[a, i] < bound:
            return -1
    for r in range(h.d2.shape[0]):
        if r != a and h.d2[r, best] < model.new_feature_gate and h.cost[r, best] < bound:
            return -1
    return best


@borrowing
def _longest_square(S: np.ndarray, a: int) -> float:
    """Square of the longest axis of prediction ``a``'s ellipse in the joint ``S`` (2 v, 2 v)."""
    s00, s01, s11 = S[2 * a, 2 * a], S[2 * a, 2 * a + 1], S[2 * a + 1, 2 * a + 1]
    half = 0.5 * (s00 + s11)
    return half + math.sqrt(max(half * half - (s00 * s11 - s01 * s01), 0.0))


# What is left, jointly ----------------------------------------------------------------------------------------------


class Search(NamedTuple):
    """A search of n predictions and M detections: what is asked, and the greatest scores that were found."""

    detections: np.ndarray  # (M,) DETECTION
    pair_worth: float  # log likelihood ratio of a pair against an unmapped detection, plus half of its cost
    most: float  # upper bound of the worth of any pair
    with_answer: np.ndarray  # (n, M + 1) scores in which the prediction is the detection; in the last column, is missed
    answer: np.ndarray  # (n,) the best assignment
    best: np.ndarray  # (1,) and its score
    nodes: np.ndarray  # (1,) partial assignments so far


@compiled
def match_jointly(
    model: Record,
    h: Hypotheses,
    points: np.ndarray,
    detections: np.ndarray,
    pair_worth: float,
    matches: np.ndarray,
) -> bool:
    """Match the open predictions of ``h`` together, write ``matches`` (v,), and condition the rest on the matches.

    Returns whether another search can find no more: this one took all predictions in reach, or matched none. It is
    bounded by nodes, never by the clock: where they run out, the sharper half of the predictions is searched by itself,
    which sharpens the others for the next search.
    """
    in_reach, matched = _in_reach(model, h), 0
    if in_reach.shape[0] == 0:
        return True
    chosen = in_reach[:MOST_POINTS]
    search = _search(model, h, chosen, detections, pair_worth)
    while search.nodes[0] > model.nodes and chosen.shape[0] > 2:
        chosen = chosen[: chosen.shape[0] // 2]
        search = _search(model, h, chosen, detections, pair_worth)
    if search.nodes[0] > model.nodes:
        return True
    for k in range(chosen.shape[0]):
        a, i, other = chosen[k], search.answer[k], -np.inf
        for j in range(detections.shape[0] + 1):
            other = max(other, search.with_answer[k, j]) if j != i else other
        lately = points[a].id > 0 and points[a].unseen <= model.lately
        lead = model.lately_margin if lately else model.margin
        if i != detections.shape[0] and search.best[0] - other >= lead:
            matches[a] = i
            accept(h, a, i, detections)
            matched += 1
    measure_distances(h, detections)
    return matched == 0 or chosen.shape[0] == in_reach.shape[0]


@compiled
def _in_reach(model: Record, h: Hypotheses) -> np.ndarray:
    """The predictions with a detection inside the initialisation gate, the sharpest first, by tr S."""
    chosen, size, n = np.empty(h.d2.shape[0], np.int64), np.empty(h.d2.shape[0]), 0
    for a in range(h.d2.shape[0]):
        near = False
        for i in range(h.d2.shape[1]):
            near |= h.d2[a, i] < model.new_feature_gate
        if near:
            trace, k = h.S[2 * a, 2 * a] + h.S[2 * a + 1, 2 * a + 1], n
            while k > 0 and size[k - 1] > trace:
                chosen[k], size[k] = chosen[k - 1], size[k - 1]
                k -= 1
            chosen[k], size[k] = a, trace
            n += 1
    return chosen[:n]


@compiled
def _search(model: Record, h: Hypotheses, chosen: np.ndarray, detections: np.ndarray, pair_worth: float) -> Search:
    """Search the ``chosen`` (n,) predictions; more than ``model.nodes`` in its ``nodes``: they ran out."""
    n, M, rows, most = chosen.shape[0], detections.shape[0], pixel_rows(chosen), 0.0
    for i in range(M):  # no prediction is sharper than the detection itself
        R = detections[i].R
        own = pair_worth + detections[i].log_ratio - 0.5 * math.log(R[0, 0] * R[1, 1] - R[0, 1] * R[0, 1])
        most = max(most, own)
    scores, missed, best = np.full((n, M + 1), -np.inf), np.full(n, M), np.full(1, -np.inf)
    search = Search(detections, pair_worth, most, scores, missed, best, np.zeros(1, np.int64))
    part = Hypotheses(h.z[rows], submatrix(h.S, rows), h.d2[chosen], h.cost[chosen])
    _explore(model, part, search, missed.copy(), np.ones(n, np.bool_), 0.0)
    return search


@compiled
def _explore(model: Record, h: Hypotheses, search: Search, answer: np.ndarray, open: np.ndarray, score: float) -> None:
    """Follow the assignments that begin with the ``answer`` (n,) and ``score`` so far, the likeliest first.

    Of those that are ``open`` (n,), the prediction with the fewest detections in its gate is decided, and the others
    are conditioned on it.
    """
    (n, M), detections = h.d2.shape, search.detections
    decided, fewest, others, pairs, reached = -1, M + 1, -1, 0, np.zeros(M, np.bool_)
    for a in range(n):
        near = 0
        for i in range(M):
            if h.d2[a, i] < model.new_feature_gate:
                near += 1
                pairs += not reached[i]
                reached[i] = True
        if near > 0:
            others += 1
            if near < fewest:
                fewest, decided = near, a
        elif open[a]:
            h.d2[a, :], open[a] = np.inf, False
            score += log_missed(model, h, a)
    if decided < 0:
        for a in range(n):
            search.with_answer[a, answer[a]] = max(search.with_answer[a, answer[a]], score)
        if score > search.best[0]:
            search.best[0] = score
            copy_into(search.answer, answer)
        return
    rest = search.most * min(others, pairs)  # upper bound of what the others add
    for i in _choices(model, h, decided):
        worth = log_missed(model, h, decided) if i == M else search.pair_worth - 0.5 * h.cost[decided, i]
        if score + worth + rest < search.best[0] - model.margin:
            continue
        search.nodes[0] += 1
        if search.nodes[0] > model.nodes:
            return
        left, below = open.copy(), Hypotheses(h.z, h.S, h.d2.copy(), h.cost)  # a miss changes no other prediction
        answer[decided], left[decided] = i, False
        if i < M:
            below = Hypotheses(h.z.copy(), h.S.copy(), below.d2, h.cost.copy())
            accept(below, decided, i, detections)
            measure_distances(below, detections)
        below.d2[decided, :] = np.inf
        _explore(model, below, search, answer.copy(), left, score + worth)


@compiled
def _choices(model: Record, h: Hypotheses, a: int) -> np.ndarray:
    """The detections near prediction ``a``, the likeliest first, and M: it is missed."""
    M, count = h.d2.shape[1], 0
    choices = np.empty(M + 1, np.int64)
    for i in range(M):
        if h.d2[a, i] < model.new_feature_gate:
            k = count
            while k > 0 and h.cost[a, choices[k - 1]] > h.cost[a, i]:
                choices[k] = choices[k - 1]
                k -= 1
            choices[k] = i
            count += 1
    choices[count] = M
    return choices[: count + 1]


@borrowing
def log_missed(model: Record, h: Hypotheses, a: int) -> float:
    """ln(1 - P_D P(in the image)) of prediction ``a``, the axes of its measured pixel taken as independent."""
    wide_u = math.sqrt(2.0 * (h.S[2 * a, 2 * a] + model.pixel_var))
    wide_v = math.sqrt(2.0 * (h.S[2 * a + 1, 2 * a + 1] + model.pixel_var))
    u, v = h.z[2 * a], h.z[2 * a + 1]
    inside_u = 0.5 * (math.erf((model.width - u) / wide_u) + math.erf(u / wide_u))
    inside_v = 0.5 * (math.erf((model.height - v) / wide_v) + math.erf(v / wide_v))
    return math.log(1.0 - model.detection_probability * inside_u * inside_v)
