"""Unknown correspondence: joint, unambiguous matches inside chi-square gates.

The paper gives each measurement to the nearest predicted feature inside its ellipse, alone. That is where single runs
go wrong (fiducials swapped under the prior's wide ellipses, a wrong landmark taken on re-entry after a full turn), and
one wrong match makes the next ones. So a match must be more than near:

1. "Near" is by likelihood, cost = d^2 + ln |S|: plain Mahalanobis distance favours whatever is uncertain.
2. A sharply predicted row is matched if it and the detection are each other's best and no rival inside the birth gate
   comes within a margin. The joint Gaussian of the other predicted pixels is then conditioned on it, which sharpens
   them too (sequential compatibility nearest neighbour, with the compatibility test that Neira and Tardos, "Data
   association in stochastic mapping using the joint compatibility test", 2001, ask for).
3. A vaguely predicted row is matched only with support: given it, another row's detection falls into its gate; and only
   if the pairing beats its rivals by a margin. If its ellipse reaches over the image's edge, its own detection may be
   outside while a stranger's lies near: then the support has to be strong. (Loops are closed at the edge of the image.)
4. Everything else waits for a clearer frame: it gives no birth, and it is no miss.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, compiled, filled, record
from activeslam_gym.slam.sight import INSIDE, Sight

CANDIDATE = record(
    pixel=("f8", 2),  # [px]
    R=("f8", (2, 2)),  # covariance of its noise [px^2]
    id="i8",  # of the one thing that it may be; ANYTHING: any
    log_ratio="f8",  # log likelihood of its appearance, if it is that thing, over a stranger's
    match="i8",  # the filter's answer: the id of the thing that it was taken for, or NEW or REJECTED
)
"""A pixel that may be a measurement. The ids are those of features (positive) and of fiducials (negative)."""
ANYTHING = 0
NEW, REJECTED = 0, -(2**62)
"""A candidate outside every birth gate; one that is near a prediction but no match."""

ASSOCIATION = record(
    gate="f8",  # chi-square bound of a match
    birth_gate="f8",  # and of what is near a prediction
    sharp_std_px="f8",  # a predicted ellipse is sharp when its longest axis is at most this
    clear_margin="f8",  # lead over its rivals that a match of a sharp row needs, in -2 ln of the likelihood
    support_margin="f8",  # the same for a vague row, whose worth includes what it makes others explain
    edge_worth="f8",  # worth that a vague row needs where its ellipse reaches over the image's edge, in ln
    clutter_cost="f8",  # -2 ln of a stranger's density
)
"""Constants of the association."""


def association_of(scenario: Scenario) -> Record:
    """The ASSOCIATION record of a scenario."""
    return filled(
        ASSOCIATION,
        gate=chi_square_2_quantile(scenario.gate_probability),
        birth_gate=chi_square_2_quantile(scenario.birth_gate_probability),
        sharp_std_px=2.0 * scenario.pixel_std,
        clear_margin=8.0,
        support_margin=12.0,
        edge_worth=18.0,
        clutter_cost=2.0 * math.log(scenario.image_width * scenario.image_height / (2.0 * math.pi)),
    )


def chi_square_2_quantile(probability: float) -> float:
    """Quantile of the chi-square distribution of 2 dof, -2 ln(1 - p): 9.21 at 99 %."""
    return -2.0 * math.log(1.0 - probability)


_TIE = 1e-6
"""Pairings whose worth differs by less are equal, and the first has precedence. Two rows that support each other are
worth the same, log p(a) + log p(b | a) = log p(b) + log p(a | b): rounding must not decide between them."""


class Predicted(NamedTuple):
    """The joint Gaussian of the predicted pixels of v things."""

    z: np.ndarray
    """(2 v,) given the matches so far [px]."""
    S: np.ndarray
    """(2 v, 2 v) their joint innovation covariance, given the matches so far, with the camera's R [px^2]."""


class Hypotheses(NamedTuple):
    """What is still open between v predicted things and M candidates."""

    z: np.ndarray
    """(2 v,) predicted pixels, given the matches so far [px]."""
    S: np.ndarray
    """(2 v, 2 v) their joint innovation covariance, given the matches so far, with the camera's R [px^2]."""
    inside: np.ndarray
    """(v,) bool: things whose ellipse is inside the image, as it was predicted."""
    open: np.ndarray
    """(v,) bool: things without a match."""
    free: np.ndarray
    """(M,) bool: candidates without a match."""
    allowed: np.ndarray
    """(v, M) bool: whether the candidate may be the thing, by its id."""
    d2: np.ndarray
    """(v, M) squared Mahalanobis distances; inf where it may not."""
    cost: np.ndarray
    """(v, M) d^2 + ln |S| - 2 log_ratio: -2 ln of the likelihood, less a constant."""


@compiled
def associate(model: Record, pixel_var: float, sight: Sight, candidates: np.ndarray, waits: np.ndarray) -> np.ndarray:
    """Match ``candidates`` (M,) to the things in ``sight`` (v,).

    Returns (v,) the candidate of each thing, or -1, and sets ``candidates.match``. ``pixel_var`` is that of the R in
    ``sight.S``; ``waits`` (v,) bool is set for the things that a candidate may be of without being clear enough to
    match.
    """
    v, M = sight.thing.shape[0], candidates.shape[0]
    h = Hypotheses(
        np.empty(2 * v),
        sight.S.copy(),
        np.empty(v, np.bool_),
        np.ones(v, np.bool_),
        np.ones(M, np.bool_),
        np.empty((v, M), np.bool_),
        np.full((v, M), np.inf),
        np.full((v, M), np.inf),
    )
    for a in range(v):
        thing = sight.thing[a]
        h.z[2 * a], h.z[2 * a + 1], h.inside[a] = thing.z_hat[0], thing.z_hat[1], thing.visibility == INSIDE
        for i in range(M):
            h.allowed[a, i] = candidates[i].id == ANYTHING or candidates[i].id == thing.id
    of_thing = np.full(v, -1)
    _measure_distances(h, candidates, pixel_var)
    while _any_open(model, h):
        matched = _match_clear(model, h, candidates, pixel_var, of_thing)
        if not matched and not _match_supported(model, h, candidates, pixel_var, of_thing):
            break
    for i in range(M):
        candidates[i].match = NEW
        for a in range(v):
            if h.free[i] and h.d2[a, i] < model.birth_gate:
                candidates[i].match = REJECTED
                if h.open[a]:
                    waits[a] = True
    for a in range(v):
        if of_thing[a] >= 0:
            candidates[of_thing[a]].match = sight.thing[a].id
    return of_thing


@compiled
def _measure_distances(h: Hypotheses, candidates: np.ndarray, pixel_var: float) -> None:
    """Distances and costs of the open things."""
    for a in range(h.open.shape[0]):
        if not h.open[a]:
            continue
        r00, r01, r11, log_det = pixel_var, 0.0, pixel_var, math.nan  # of the last candidate: most share one R
        for i in range(candidates.shape[0]):
            if not h.allowed[a, i]:
                continue
            candidate, R = candidates[i], candidates[i].R
            s00, s01, s11 = innovation_with(h, a, candidate, pixel_var)
            det = max(s00 * s11 - s01 * s01, 1e-300)
            if math.isnan(log_det) or R[0, 0] != r00 or R[0, 1] != r01 or R[1, 1] != r11:
                r00, r01, r11, log_det = R[0, 0], R[0, 1], R[1, 1], math.log(det)
            x, y = candidate.pixel[0] - h.z[2 * a], candidate.pixel[1] - h.z[2 * a + 1]
            h.d2[a, i] = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / det
            h.cost[a, i] = h.d2[a, i] + log_det - 2.0 * candidate.log_ratio


@compiled
def innovation_with(
    h: Predicted | Hypotheses, a: int, candidate: Record, pixel_var: float
) -> tuple[float, float, float]:
    """(s00, s01, s11) of thing ``a``'s innovation covariance with the candidate's own R."""
    R = candidate.R
    return (
        h.S[2 * a, 2 * a] + (R[0, 0] - pixel_var),
        h.S[2 * a, 2 * a + 1] + R[0, 1],
        h.S[2 * a + 1, 2 * a + 1] + (R[1, 1] - pixel_var),
    )


@compiled
def _any_open(model: Record, h: Hypotheses) -> bool:
    """Whether an open thing and a free candidate may still belong together."""
    for a in range(h.open.shape[0]):
        if h.open[a]:
            for i in range(h.free.shape[0]):
                if h.free[i] and h.d2[a, i] < model.birth_gate:
                    return True
    return False


@compiled
def _close(h: Hypotheses, a: int, i: int) -> None:
    h.open[a] = False
    h.free[i] = False


@compiled
def condition(h: Predicted | Hypotheses, others: np.ndarray, a: int, candidate: Record, pixel_var: float) -> None:
    """Condition the joint Gaussian of ``others`` (v,) bool, of which ``a`` is none, on thing ``a`` being ``candidate``.

    Of all other things the rows of ``h.S`` stay as they are.
    """
    z, S = h.z, h.S
    s00, s01, s11 = innovation_with(h, a, candidate, pixel_var)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = candidate.pixel[0] - z[2 * a], candidate.pixel[1] - z[2 * a + 1]
    c0, c1 = S[2 * a], S[2 * a + 1]
    for i in range(z.shape[0]):
        if not others[i // 2]:
            continue
        g0, g1, row = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det, S[i]
        z[i] += g0 * x + g1 * y
        for j in range(c0.shape[0]):
            row[j] -= g0 * c0[j] + g1 * c1[j]


@compiled
def _is_sharp(model: Record, h: Hypotheses, a: int) -> bool:
    """Whether the longest axis of thing ``a``'s ellipse is within the limit."""
    s00, s01, s11 = h.S[2 * a, 2 * a], h.S[2 * a, 2 * a + 1], h.S[2 * a + 1, 2 * a + 1]
    half = 0.5 * (s00 + s11)
    longest = half + math.sqrt(max(half * half - (s00 * s11 - s01 * s01), 0.0))
    return longest <= model.sharp_std_px**2


@compiled
def _match_clear(model: Record, h: Hypotheses, candidates: np.ndarray, pixel_var: float, of_thing: np.ndarray) -> bool:
    """Match every sharp thing that has a clear partner, then condition the rest on them; whether there was any."""
    v = h.open.shape[0]
    partner = np.full(v, -1)
    found = False
    for a in range(v):
        if h.open[a] and _is_sharp(model, h, a):
            partner[a] = _clear_partner(model, h, a)
            found |= partner[a] >= 0
    others = h.open.copy()
    for a in range(v):
        if partner[a] >= 0:
            of_thing[a] = partner[a]
            _close(h, a, partner[a])
    if found and _any_open(model, h):
        for a in range(v):
            if partner[a] >= 0:
                others[a] = False
                condition(h, others, a, candidates[partner[a]], pixel_var)
        _measure_distances(h, candidates, pixel_var)
    return found


@compiled
def _clear_partner(model: Record, h: Hypotheses, a: int) -> int:
    """The free candidate that is thing ``a``'s best by a margin, and whose best by a margin is thing ``a``; or -1."""
    best = -1
    for i in range(h.free.shape[0]):
        if h.free[i] and h.d2[a, i] < model.gate and (best < 0 or h.cost[a, i] < h.cost[a, best]):
            best = i
    if best < 0:
        return -1
    bound = h.cost[a, best] + model.clear_margin
    for i in range(h.free.shape[0]):
        if i != best and h.free[i] and h.d2[a, i] < model.birth_gate and h.cost[a, i] < bound:
            return -1
    for r in range(h.open.shape[0]):
        if r != a and h.open[r] and h.d2[r, best] < model.birth_gate and h.cost[r, best] < bound:
            return -1
    return best


@compiled
def _match_supported(
    model: Record, h: Hypotheses, candidates: np.ndarray, pixel_var: float, of_thing: np.ndarray
) -> bool:
    """Match the vague row whose pairing explains the most together with what it implies; whether there was one.

    A pairing's worth is its log likelihood ratio against clutter, plus the best of each other row's given it. It needs
    at least one such support, and a margin over every pairing of the same row or the same detection. The wider gate
    holds here: what many rows share, as an unlucky prior, takes them all out of their own 99 % gates at once, and it is
    the support that tells.
    """
    m, M = h.open.shape[0], h.free.shape[0]
    worth = np.full((m, M), -np.inf)
    best_a, best_i = -1, -1
    for a in range(m):
        if not h.open[a]:
            continue
        vague = not _is_sharp(model, h, a)
        for i in range(M):
            if h.free[i] and h.d2[a, i] < model.birth_gate:
                support = _support(model, h, a, i, candidates, pixel_var)
                worth[a, i] = 0.5 * (model.clutter_cost - h.cost[a, i]) + support
                enough = support > 0.0 and (h.inside[a] or worth[a, i] > model.edge_worth)
                if vague and enough and (best_a < 0 or worth[a, i] > worth[best_a, best_i] + _TIE):
                    best_a, best_i = a, i
    if best_a < 0:
        return False
    bound = worth[best_a, best_i] - 0.5 * model.support_margin
    for a in range(m):
        if a != best_a and worth[a, best_i] > bound:
            return False
    for i in range(M):
        if i != best_i and worth[best_a, i] > bound:
            return False
    of_thing[best_a] = best_i
    _close(h, best_a, best_i)
    condition(h, h.open, best_a, candidates[best_i], pixel_var)
    _measure_distances(h, candidates, pixel_var)
    return True


@compiled
def _support(model: Record, h: Hypotheses, a: int, i: int, candidates: np.ndarray, pixel_var: float) -> float:
    """Sum over the other open things of their best log likelihood ratio, given that thing ``a`` is candidate ``i``."""
    trial = Hypotheses(
        h.z.copy(), h.S.copy(), h.inside, h.open.copy(), h.free.copy(), h.allowed, h.d2.copy(), h.cost.copy()
    )
    _close(trial, a, i)
    condition(trial, trial.open, a, candidates[i], pixel_var)
    _measure_distances(trial, candidates, pixel_var)
    total = 0.0
    for r in range(trial.open.shape[0]):
        best = 0.0
        for j in range(trial.free.shape[0]):
            if trial.open[r] and trial.free[j] and trial.d2[r, j] < model.gate:
                best = max(best, 0.5 * (model.clutter_cost - trial.cost[r, j]))
        total += best
    return total
