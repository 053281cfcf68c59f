"""Joint matching: what the open predictions are, all together, by branch and bound over their joint Gaussian.

An assignment gives each prediction a detection or none. Its log likelihood, against "all are of nothing known", is

    sum over pairs    ln N(z; z_hat, S | the pairs before) - ln(unmapped detections per px^2)
  + sum over others   ln(1 - P_D P(its pixel is in the image)).

A pair is accepted when the best assignment leads every one that makes something else of the prediction by a margin, one
for another detection and one for none; and a detection is of nothing known when the best that leaves it unexplained
leads every one that explains it. (Neira and Tardos, "Data association in stochastic mapping using the joint
compatibility test", 2001, count pairs; here wide ellipses pay for their width, and misses for standing in the image.)
The search is bounded by nodes, never by the clock: where they run out, the sharper half of the predictions is searched
by itself, which sharpens the others for the next search.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled, inlined
from activeslam_gym.linalg import cholesky_in_place, copy_block, copy_into, diagonal, solve_transposed
from activeslam_gym.slam.hypotheses import Hypotheses, accept, condition, measure_distances
from activeslam_gym.slam.sight import pixel_rows

MOST_THINGS = 14  # a search takes so many predictions, the sharpest
MISSED = -1  # the answer in place of the number of a detection


class Margins(NamedTuple):
    """The lead that the answer for a prediction needs over any other, in ln; at most ``model.margin``."""

    other: np.ndarray  # (v,) another detection
    missed: np.ndarray  # (v,) none


class Search(NamedTuple):
    """A depth-first search that decides one prediction a level; n + 1 levels of n predictions and M detections."""

    thing: np.ndarray  # (n + 1,) the one that the level decides
    choice: np.ndarray  # (n + 1, M + 1) what it may be: detections, the likeliest first, and MISSED
    choices: np.ndarray  # (n + 1,) how many these are
    tried: np.ndarray  # (n + 1,) and how many of them have been followed
    answer: np.ndarray  # (n + 1, n) the decisions so far
    score: np.ndarray  # (n + 1,) their log likelihood
    rest: np.ndarray  # (n + 1,) upper bound of what the other open predictions add
    most: np.ndarray  # (n,) upper bound of the worth of any pair of the prediction
    reached: np.ndarray  # (M,) room to mark what some open prediction reaches
    pair_worth: float  # see `worth_of_pair`


class Outcome(NamedTuple):
    """The greatest scores that were found."""

    with_pair: np.ndarray  # (n, M + 1) of those in which the prediction is the detection; in the last column, is missed
    without: np.ndarray  # (M,) of those that leave the detection unexplained
    answer: np.ndarray  # (n,) the best


@compiled
def match_jointly(
    model: Record,
    h: Hypotheses,
    detections: np.ndarray,
    pair_worth: float,
    margins: Margins,
    of_thing: np.ndarray,
    novelty: np.ndarray,
) -> tuple[int, bool]:
    """Match the open predictions of ``h`` together, and condition the rest on the matches.

    Returns how many were matched, and whether the search took all predictions in reach.

    ``model``: ASSOCIATION; ``pair_worth``: see `worth_of_pair`; ``margins``: the leads that matches of the v
    predictions need. Writes ``of_thing`` (v,), and ``novelty`` (M,): by how much the best assignment that leaves a
    detection unexplained leads, 0 where the search did not take all predictions in reach.
    """
    in_reach = _in_reach(model, h)
    chosen = in_reach[:MOST_THINGS]
    outcome, best = _search(model, h, chosen, detections, pair_worth)
    while best == -np.inf and chosen.shape[0] > 2:
        chosen = chosen[: chosen.shape[0] // 2]
        outcome, best = _search(model, h, chosen, detections, pair_worth)
    novelty[:] = 0.0
    complete = best > -np.inf and chosen.shape[0] == in_reach.shape[0]
    if complete:
        _write_novelty(outcome, best, model.margin, novelty)
    matched = 0
    for k in range(chosen.shape[0]):
        a, i = chosen[k], outcome.answer[k]
        if i == MISSED:
            continue
        rivals, other = outcome.with_pair[k], -np.inf
        for j in range(rivals.shape[0] - 1):
            other = max(other, rivals[j]) if j != i else other
        if best - other >= margins.other[a] and best - rivals[-1] >= margins.missed[a]:
            of_thing[a] = i
            accept(h, a, i, detections)
            matched += 1
    measure_distances(h, detections)
    return matched, complete


@compiled
def _search(
    model: Record, h: Hypotheses, chosen: np.ndarray, detections: np.ndarray, pair_worth: float
) -> tuple[Outcome, float]:
    """The outcome for the ``chosen`` (n,) predictions, and the greatest score: -inf where the nodes ran out."""
    n, M = chosen.shape[0], detections.shape[0]
    levels = _levels(h, chosen)
    search = Search(
        np.zeros(n + 1, np.int64),
        np.empty((n + 1, M + 1), np.int64),
        np.zeros(n + 1, np.int64),
        np.zeros(n + 1, np.int64),
        np.full((n + 1, n), MISSED),
        np.zeros(n + 1),
        np.zeros(n + 1),
        _bound_pairs(levels.S[0], detections, pair_worth),
        np.empty(M, np.bool_),
        pair_worth,
    )
    outcome = Outcome(np.full((n, M + 1), -np.inf), np.full(M, -np.inf), np.full(n, MISSED))
    return outcome, _explore(model, levels, search, outcome, detections)


@compiled
def _in_reach(model: Record, h: Hypotheses) -> np.ndarray:
    """The open predictions with a free detection inside the initialisation gate, the sharpest first, by tr S."""
    chosen, size, n = np.empty(h.open.shape[0], np.int64), np.empty(h.open.shape[0]), 0
    for a in range(h.open.shape[0]):
        near = 0
        for i in range(h.free.shape[0]):
            near += h.open[a] and h.free[i] and h.d2[a, i] < model.birth_gate
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
def _levels(h: Hypotheses, chosen: np.ndarray) -> Hypotheses:
    """Room for the hypotheses of n + 1 levels, with a leading axis; the first has the ``chosen`` (n,) predictions."""
    n, M, rows = chosen.shape[0], h.free.shape[0], pixel_rows(chosen)
    levels = Hypotheses(
        np.empty((n + 1, 2 * n)),
        np.empty((n + 1, 2 * n, 2 * n)),
        np.ones((n + 1, n), np.bool_),
        np.empty((n + 1, M), np.bool_),
        h.allowed[chosen],
        np.full((n + 1, n, M), np.inf),
        np.full((n + 1, n, M), np.inf),
    )
    for a in range(2 * n):
        levels.z[0, a] = h.z[rows[a]]
        for b in range(2 * n):
            levels.S[0, a, b] = h.S[rows[a], rows[b]]
    copy_into(levels.free[0], h.free)
    return levels


@inlined
def _level(levels: Hypotheses, d: int) -> Hypotheses:
    """The hypotheses of one level: views."""
    return Hypotheses(
        levels.z[d], levels.S[d], levels.open[d], levels.free[d], levels.allowed, levels.d2[d], levels.cost[d]
    )


@borrowing
def _explore(model: Record, levels: Hypotheses, search: Search, outcome: Outcome, detections: np.ndarray) -> float:
    """Search through; the greatest score, or -inf with no answer in ``outcome`` where the nodes ran out."""
    best, nodes, depth, arrived = -np.inf, 0, 0, True
    while depth >= 0:
        if arrived and not _look(model, _level(levels, depth), search, depth, detections):
            best = _note(levels.free[depth], search, depth, outcome, best)
            depth -= 1
            arrived = False
            continue
        arrived = False
        if search.tried[depth] == search.choices[depth]:
            depth -= 1
            continue
        h, a, i = _level(levels, depth), search.thing[depth], search.choice[depth, search.tried[depth]]
        worth = log_missed(model, h, a) if i == MISSED else search.pair_worth - 0.5 * h.cost[a, i]
        score = search.score[depth] + worth
        if score + search.rest[depth] < best - model.margin:
            search.tried[depth] += 1
            continue
        nodes += 1
        if nodes > model.nodes:
            for a in range(outcome.answer.shape[0]):
                outcome.answer[a] = MISSED
            return -np.inf
        _descend(levels, search, depth, score, detections)
        depth += 1
        arrived = True
    return best


@compiled
def _bound_pairs(S: np.ndarray, detections: np.ndarray, pair_worth: float) -> np.ndarray:
    """(n,) upper bound of the worth of any pair of each prediction: at the predicted pixel, given where all others are.

    Of a joint covariance with the inverse A, what is given all others has the covariance A_aa^-1: no conditioning makes
    a prediction sharper. It is taken with the least R of the ``detections``.
    """
    n, least, ratio = S.shape[0], np.inf, -np.inf
    for i in range(detections.shape[0]):
        R = detections[i].R
        half, differ = 0.5 * (R[0, 0] + R[1, 1]), 0.5 * (R[0, 0] - R[1, 1])
        least = min(least, half - math.sqrt(differ * differ + R[0, 1] * R[0, 1]))
        ratio = max(ratio, detections[i].log_ratio)
    U, V, most = S.copy(), diagonal(np.full(n, 1.0)), np.full(n // 2, np.inf)
    for a in range(n):
        U[a, a] += least
    if cholesky_in_place(U):
        solve_transposed(U, V)
        for a in range(n // 2):
            a00, a01, a11 = 0.0, 0.0, 0.0
            for k in range(n):
                u, v = V[k, 2 * a], V[k, 2 * a + 1]
                a00, a01, a11 = a00 + u * u, a01 + u * v, a11 + v * v
            most[a] = pair_worth + ratio + 0.5 * math.log(a00 * a11 - a01 * a01)
    return most


@borrowing
def _look(model: Record, h: Hypotheses, search: Search, depth: int, detections: np.ndarray) -> bool:
    """Prepare a level: predictions without a detection are missed, and the one with the fewest is decided next.

    False where nothing is left to decide.
    """
    measure_distances(h, detections)
    n, M, reached = h.open.shape[0], h.free.shape[0], search.reached
    fewest, most, highest, pairs = M + 1, 0.0, 0.0, 0
    for i in range(M):
        reached[i] = False
    for a in range(n):
        if not h.open[a]:
            continue
        near = 0
        for i in range(M):
            if h.free[i] and h.d2[a, i] < model.birth_gate:
                near += 1
                pairs += not reached[i]
                reached[i] = True
        if near == 0:
            h.open[a] = False
            search.answer[depth, a] = MISSED
            search.score[depth] += log_missed(model, h, a)
            continue
        most += max(search.most[a], 0.0)
        highest = max(highest, search.most[a])
        if near < fewest:
            fewest, search.thing[depth] = near, a
    if fewest <= M:
        most -= max(search.most[search.thing[depth]], 0.0)
        search.rest[depth] = min(most, highest * pairs)
        _list_choices(model, h, search, depth)
    return fewest <= M


@borrowing
def _list_choices(model: Record, h: Hypotheses, search: Search, depth: int) -> None:
    """The free detections near the level's prediction, the likeliest first, and MISSED."""
    a, choice, count = search.thing[depth], search.choice[depth], 0
    for i in range(h.free.shape[0]):
        if h.free[i] and h.d2[a, i] < model.birth_gate:
            k = count
            while k > 0 and h.cost[a, choice[k - 1]] > h.cost[a, i]:
                choice[k] = choice[k - 1]
                k -= 1
            choice[k] = i
            count += 1
    choice[count] = MISSED
    search.choices[depth], search.tried[depth] = count + 1, 0


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


@borrowing
def _descend(levels: Hypotheses, search: Search, depth: int, score: float, detections: np.ndarray) -> None:
    """Follow the next choice of a level, with its ``score``, into the level below."""
    h, below, a = _level(levels, depth), _level(levels, depth + 1), search.thing[depth]
    i = search.choice[depth, search.tried[depth]]
    search.tried[depth] += 1
    copy_into(below.z, h.z)
    copy_block(h.S, below.S)
    copy_into(below.open, h.open)
    copy_into(below.free, h.free)
    copy_into(search.answer[depth + 1], search.answer[depth])
    search.answer[depth + 1, a], search.score[depth + 1] = i, score
    below.open[a] = False
    if i != MISSED:
        below.free[i] = False
        condition(below.z, below.S, below.open, a, detections[i])


@borrowing
def _note(free: np.ndarray, search: Search, depth: int, outcome: Outcome, best: float) -> float:
    """Take down a leaf; returns the best score so far."""
    score, answer, M = search.score[depth], search.answer[depth], free.shape[0]
    for a in range(answer.shape[0]):
        i = answer[a] if answer[a] != MISSED else M
        outcome.with_pair[a, i] = max(outcome.with_pair[a, i], score)
    for i in range(M):
        if free[i]:
            outcome.without[i] = max(outcome.without[i], score)
    if score > best:
        copy_into(outcome.answer, answer)
    return max(score, best)


@borrowing
def _write_novelty(outcome: Outcome, best: float, margin: float, novelty: np.ndarray) -> None:
    """How far leaving each detection unexplained leads explaining it, at most the margin."""
    for i in range(novelty.shape[0]):
        explained = best - margin
        for a in range(outcome.answer.shape[0]):
            explained = max(explained, outcome.with_pair[a, i])
        novelty[i] = max(outcome.without[i], best - margin) - explained
