"""Unknown correspondence: joint, unambiguous matches inside chi-square gates.

The paper gives each measurement to the nearest predicted feature inside its ellipse, alone. That is where single runs
go wrong (fiducials swapped under the prior's wide ellipses, a wrong landmark taken on re-entry after a full turn), and
one wrong match makes the next ones. So a match must be more than near:

1. "Near" is by likelihood, cost = d^2 + ln |S|: plain Mahalanobis distance favours whatever is uncertain.
2. A sharply predicted row is matched if it and the detection are each other's best and no rival inside the
   initialisation gate comes within a margin. The joint Gaussian of the other predicted pixels is then conditioned on
   it, which sharpens them too (sequential compatibility nearest neighbour, with the compatibility test that Neira and
   Tardos, "Data association in stochastic mapping using the joint compatibility test", 2001, ask for).
3. What is left is matched jointly, by branch and bound over the joint Gaussian. An assignment gives each prediction a
   detection or none; its log likelihood, against "all are of nothing known", is

       sum over pairs    ln N(z; z_hat, S | the pairs before) - ln(unmapped detections per px^2)
     + sum over others   ln(1 - P_D P(its pixel is in the image)).

   (Neira and Tardos count pairs; here wide ellipses pay for their width, and misses for standing in the image.) A pair
   is accepted when the best assignment leads every one that makes something else of the prediction by a margin, a
   smaller one where it was seen lately: what comes back after a long time does so beside landmarks of which nothing is
   known, by a pose that has drifted. That closes loops, and finds the way back where wide ellipses are ambiguous one by
   one.
4. Everything else that is near a prediction, given all matches, waits for a clearer frame: it gives no initialisation,
   and it is no miss.
5. Two predictions side by side wait too, however clear their matches seem. Between them the noise decides, and
   to match whenever it pulls them apart would make them drift apart in the map, until one is taken for the other.
6. So does a feature by inverse depth while two detections that no other prediction explains are in its gate, given the
   other matches, and a moment longer: its ellipse is long, and takes the one for the other when that is missed.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants, record
from activeslam_gym.linalg import copy_into, squared_distance, submatrix
from activeslam_gym.slam.belief import INVERSE_DEPTH, KIND_DIM
from activeslam_gym.slam.sight import Sight, pixel_rows

DETECTION = record(
    pixel=("f8", 2),  # [px]
    R=("f8", (2, 2)),  # covariance of its noise [px^2]
    id="i8",  # of the one prediction that it may be; UNASSOCIATED: any
    log_ratio="f8",  # log likelihood of its appearance, if it is that prediction, over an unmapped detection's
    match="i8",  # the filter's answer: the id of the prediction that it was matched to, or NEW or REJECTED
)
"""A measured pixel before its association. The ids are those of features (positive) and of fiducials (negative)."""
UNASSOCIATED = 0
MOST_POINTS = 14  # a joint search takes so many predictions, the sharpest
NEW, REJECTED = 0, -(2**62)
"""A detection that nothing known explains; one that something may explain, too unclear to be used."""


def chi_square_2_quantile(probability: float) -> float:
    """Quantile of the chi-square distribution of 2 dof, -2 ln(1 - p): 9.21 at 99 %."""
    return -2.0 * math.log(1.0 - probability)


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


class Hypotheses(NamedTuple):
    """The open questions between v predictions and M detections."""

    z: np.ndarray  # (2 v,) predicted pixels, given the matches so far [px]
    S: np.ndarray  # (2 v, 2 v) their joint covariance, given the matches so far; each detection adds its own R [px^2]
    open: np.ndarray  # (v,) bool: predictions without a match
    free: np.ndarray  # (M,) bool: detections without a match
    d2: np.ndarray  # (v, M) squared Mahalanobis distances; inf where the detection is of another id
    cost: np.ndarray  # (v, M) d^2 + ln |S + R| - 2 log_ratio: -2 ln of the likelihood, less a constant


@compiled
def associate(model: Record, sight: Sight, detections: np.ndarray, features: int, waits: np.ndarray) -> np.ndarray:
    """Match ``detections`` (M,) to the predictions in ``sight`` (v,) of a map with so many ``features``.

    Returns (v,) the detection of each prediction, or -1, and sets ``detections.match``. ``waits`` (v,) bool is set for
    the predictions that a detection may be of without being clear enough to match.
    """
    h, v, M = _open_questions(sight, detections), sight.point.shape[0], detections.shape[0]
    of_point = np.full(v, -1)
    pair_worth = worth_of_pair(model, expected_unmapped(model, features))
    settled = False  # what a search of everything leaves open stays so
    while _any_open(model, h):
        if _match_clear(model, h, detections, of_point):
            continue
        if settled:
            break
        settled = match_jointly(model, h, sight.point, detections, pair_worth, of_point)
    h.open[:] = True
    measure_distances(h, detections)  # given all matches
    for i in range(M):
        detections[i].match = NEW
        for a in range(v):
            if h.free[i] and h.d2[a, i] < model.new_feature_gate:
                detections[i].match = REJECTED
                waits[a] |= of_point[a] < 0
    for a in range(v):
        i = of_point[a]
        if i >= 0 and detections[i].id == UNASSOCIATED and _has_twin(model, sight.point, a):
            detections[i].match, of_point[a], waits[a] = REJECTED, -1, True
        elif i >= 0:
            detections[i].match = sight.point[a].id
    for a in range(v):
        i, point = of_point[a], sight.point[a]
        if point.width == KIND_DIM[INVERSE_DEPTH] and _is_crowded(model, h, a, detections, point.id):
            point.crowded = 0
        if i >= 0 and detections[i].id == UNASSOCIATED and point.crowded < model.crowded:
            detections[i].match, of_point[a], waits[a] = REJECTED, -1, True
    return of_point


@compiled
def _open_questions(sight: Sight, detections: np.ndarray) -> Hypotheses:
    """All predictions open, all detections free, and their distances."""
    v, M = sight.point.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    h = Hypotheses(z, S, np.ones(v, np.bool_), np.ones(M, np.bool_), np.zeros((v, M)), np.full((v, M), np.inf))
    for a in range(v):
        for i in range(M):
            if detections[i].id != UNASSOCIATED and detections[i].id != sight.point[a].id:
                h.d2[a, i] = np.inf
    measure_distances(h, detections)
    return h


@borrowing
def _any_open(model: Record, h: Hypotheses) -> bool:
    """Whether an open prediction and a free detection may still belong together."""
    for a in range(h.open.shape[0]):
        for i in range(h.free.shape[0]):
            if h.open[a] and h.free[i] and h.d2[a, i] < model.new_feature_gate:
                return True
    return False


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
def _match_clear(model: Record, h: Hypotheses, detections: np.ndarray, of_point: np.ndarray) -> bool:
    """Match every sharp prediction that has a clear partner, and condition the rest on them; whether there was any."""
    v, found = h.open.shape[0], False
    partner = np.full(v, -1)
    for a in range(v):
        if h.open[a] and _longest_square(h.S, a) <= model.sharp_var:
            partner[a] = _clear_partner(model, h, a)
            found |= partner[a] >= 0
    for a in range(v):
        if partner[a] >= 0:
            of_point[a] = partner[a]
            accept(h, a, partner[a], detections)
    if found:
        measure_distances(h, detections)
    return found


@borrowing
def _clear_partner(model: Record, h: Hypotheses, a: int) -> int:
    """The free detection that is the best of prediction ``a`` by a margin, as ``a`` is of the detection; or -1."""
    best = -1
    for i in range(h.free.shape[0]):
        if h.free[i] and h.d2[a, i] < model.gate and (best < 0 or h.cost[a, i] < h.cost[a, best]):
            best = i
    if best < 0:
        return -1
    bound = h.cost[a, best] + model.clear_margin
    for i in range(h.free.shape[0]):
        if i != best and h.free[i] and h.d2[a, i] < model.new_feature_gate and h.cost[a, i] < bound:
            return -1
    for r in range(h.open.shape[0]):
        if r != a and h.open[r] and h.d2[r, best] < model.new_feature_gate and h.cost[r, best] < bound:
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
    pair_worth: float  # see `worth_of_pair`
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
    of_point: np.ndarray,
) -> bool:
    """Match the open predictions of ``h`` together, write ``of_point`` (v,), and condition the rest on the matches.

    Returns whether another search can find no more: this one took all predictions in reach, or matched none. It is
    bounded by nodes, never by the clock: where they run out, the sharper half of the predictions is searched by itself,
    which sharpens the others for the next search.
    """
    in_reach, matched = _in_reach(model, h), 0
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
            of_point[a] = i
            accept(h, a, i, detections)
            matched += 1
    measure_distances(h, detections)
    return matched == 0 or chosen.shape[0] == in_reach.shape[0]


@compiled
def _in_reach(model: Record, h: Hypotheses) -> np.ndarray:
    """The open predictions with a free detection inside the initialisation gate, the sharpest first, by tr S."""
    chosen, size, n = np.empty(h.open.shape[0], np.int64), np.empty(h.open.shape[0]), 0
    for a in range(h.open.shape[0]):
        near = 0
        for i in range(h.free.shape[0]):
            near += h.open[a] and h.free[i] and h.d2[a, i] < model.new_feature_gate
        if near > 0:
            trace = h.S[2 * a, 2 * a] + h.S[2 * a + 1, 2 * a + 1]
            k = n
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
    search = Search(
        detections,
        pair_worth,
        most,
        np.full((n, M + 1), -np.inf),
        np.full(n, M),
        np.full(1, -np.inf),
        np.zeros(1, np.int64),
    )
    part = Hypotheses(h.z[rows], submatrix(h.S, rows), h.open[chosen], h.free.copy(), h.d2[chosen], h.cost[chosen])
    _explore(model, part, search, np.full(n, M), 0.0)
    return search


@compiled
def _explore(model: Record, h: Hypotheses, search: Search, answer: np.ndarray, score: float) -> None:
    """Follow the assignments that begin with the ``answer`` (n,) and ``score`` so far, the likeliest first.

    The prediction with the fewest free detections in its gate is decided, and the others are conditioned on it.
    """
    n, M, detections = h.open.shape[0], h.free.shape[0], search.detections
    measure_distances(h, detections)
    decided, fewest, others, pairs, reached = -1, M + 1, -1, 0, np.zeros(M, np.bool_)
    for a in range(n):
        near = 0
        for i in range(M):
            if h.open[a] and h.free[i] and h.d2[a, i] < model.new_feature_gate:
                near += 1
                pairs += not reached[i]
                reached[i] = True
        if near > 0:
            others += 1
            if near < fewest:
                fewest, decided = near, a
        elif h.open[a]:
            h.open[a] = False
            score += log_missed(model, h, a)
    if decided < 0:
        for a in range(n):
            search.with_answer[a, answer[a]] = max(search.with_answer[a, answer[a]], score)
        if score > search.best[0]:
            search.best[0] = score
            copy_into(search.answer, answer)
        return
    rest = search.most * min(others, pairs)  # upper bound of what the others add
    choices = _choices(model, h, decided)
    for i in choices:
        worth = log_missed(model, h, decided) if i == M else search.pair_worth - 0.5 * h.cost[decided, i]
        if score + worth + rest < search.best[0] - model.margin:
            continue
        search.nodes[0] += 1
        if search.nodes[0] > model.nodes:
            return
        below = Hypotheses(h.z.copy(), h.S.copy(), h.open.copy(), h.free.copy(), h.d2.copy(), h.cost.copy())
        answer[decided] = i
        if i == M:
            below.open[decided] = False
        else:
            accept(below, decided, i, detections)
        _explore(model, below, search, answer.copy(), score + worth)


@compiled
def _choices(model: Record, h: Hypotheses, a: int) -> np.ndarray:
    """The free detections near prediction ``a``, the likeliest first, and M: it is missed."""
    choices, count = np.empty(h.free.shape[0] + 1, np.int64), 0
    for i in range(h.free.shape[0]):
        if h.free[i] and h.d2[a, i] < model.new_feature_gate:
            k = count
            while k > 0 and h.cost[a, choices[k - 1]] > h.cost[a, i]:
                choices[k] = choices[k - 1]
                k -= 1
            choices[k] = i
            count += 1
    choices[count] = h.free.shape[0]
    return choices[: count + 1]


@borrowing
def worth_of_pair(model: Record, unmapped: float) -> float:
    """The log likelihood ratio of a pair against an unmapped detection, plus half of the pair's cost."""
    return 0.5 * model.clutter_cost - math.log(unmapped)


@borrowing
def log_missed(model: Record, h: Hypotheses, a: int) -> float:
    """ln(1 - P_D P(in the image)) of prediction ``a``, the axes of its measured pixel taken as independent."""
    wide_u = math.sqrt(2.0 * (h.S[2 * a, 2 * a] + model.pixel_var))
    wide_v = math.sqrt(2.0 * (h.S[2 * a + 1, 2 * a + 1] + model.pixel_var))
    u, v = h.z[2 * a], h.z[2 * a + 1]
    inside_u = 0.5 * (math.erf((model.width - u) / wide_u) + math.erf(u / wide_u))
    inside_v = 0.5 * (math.erf((model.height - v) / wide_v) + math.erf(v / wide_v))
    return math.log(1.0 - model.detection_probability * inside_u * inside_v)


# The joint Gaussian of the predicted pixels -------------------------------------------------------------------------


@compiled
def predicted_pixels(sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Predicted pixels (2 v,) [px] and their joint covariance (2 v, 2 v) [px^2], without the R of a measurement."""
    z, S = np.empty(sight.S.shape[0]), sight.S.copy()
    for r in range(z.shape[0]):
        point, first = sight.point[r // 2], r - r % 2
        z[r] = point.z_hat[r % 2]
        S[r, first] -= point.R[r % 2, 0]
        S[r, first + 1] -= point.R[r % 2, 1]
    return z, S


@borrowing
def innovation_of(S: np.ndarray, a: int, detection: Record) -> tuple[float, float, float]:
    """(s00, s01, s11) of S_aa + R: prediction ``a``'s innovation covariance with the R of the ``detection``."""
    R = detection.R
    return S[2 * a, 2 * a] + R[0, 0], S[2 * a, 2 * a + 1] + R[0, 1], S[2 * a + 1, 2 * a + 1] + R[1, 1]


@borrowing
def distance_and_det(z: np.ndarray, S: np.ndarray, a: int, detection: Record) -> tuple[float, float]:
    """(d^2, |S_aa + R|): the squared Mahalanobis distance of a detection from prediction ``a``."""
    s00, s01, s11 = innovation_of(S, a, detection)
    return squared_distance(s00, s01, s11, detection.pixel[0] - z[2 * a], detection.pixel[1] - z[2 * a + 1])


@borrowing
def distance_by_own_noise(z_hat: np.ndarray, S: np.ndarray, R: np.ndarray, detection: Record) -> tuple[float, float]:
    """The same from the predicted pixel ``z_hat`` (2,) and its ``S``, with the detection's R in place of ``R`` in S."""
    own, z = detection.R, detection.pixel
    s00, s01, s11 = S[0, 0] + (own[0, 0] - R[0, 0]), S[0, 1] + (own[0, 1] - R[0, 1]), S[1, 1] + (own[1, 1] - R[1, 1])
    return squared_distance(s00, s01, s11, z[0] - z_hat[0], z[1] - z_hat[1])


@borrowing
def measure_distances(h: Hypotheses, detections: np.ndarray) -> None:
    """Write distances and costs of the open predictions."""
    for a in range(h.open.shape[0]):
        if not h.open[a]:
            continue
        last, log_det = math.nan, math.nan  # of the detection before: most share one R
        for i in range(detections.shape[0]):
            if h.d2[a, i] < np.inf:
                h.d2[a, i], det = distance_and_det(h.z, h.S, a, detections[i])
                if det != last:
                    last, log_det = det, math.log(det)
                h.cost[a, i] = h.d2[a, i] + log_det - 2.0 * detections[i].log_ratio


@compiled
def accept(h: Hypotheses, a: int, i: int, detections: np.ndarray) -> None:
    """Match prediction ``a`` to detection ``i``, and condition all predictions on it."""
    h.open[a] = False
    h.free[i] = False
    condition(h.z, h.S, a, detections[i])


@compiled
def condition(z: np.ndarray, S: np.ndarray, a: int, detection: Record) -> None:
    """Condition the joint Gaussian on prediction ``a`` being ``detection``.

    z += S_:a (S_aa + R)^-1 nu, S -= S_:a (S_aa + R)^-1 S_a:.
    """
    s00, s01, s11 = innovation_of(S, a, detection)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = detection.pixel[0] - z[2 * a], detection.pixel[1] - z[2 * a + 1]
    c0, c1 = S[2 * a].copy(), S[2 * a + 1].copy()
    for i in range(z.shape[0]):
        g0, g1, row = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det, S[i]
        z[i] += g0 * x + g1 * y
        for j in range(c0.shape[0]):
            row[j] -= g0 * c0[j] + g1 * c1[j]
