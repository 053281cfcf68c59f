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

from activeslam_gym.compilation import part
from activeslam_gym.slam.measurement import INSIDE, Predictions
from activeslam_gym.slam.settings import FilterModel

NEW, REJECTED = -1, -2
"""A detection outside every birth gate; one that is near a prediction but no match."""
_TIE = 1e-6
"""Pairings whose worth differs by less are equal, and the first has precedence. Two rows that support each other are
worth the same, log p(a) + log p(b | a) = log p(b) + log p(a | b): rounding must not decide between them."""


class Hypotheses(NamedTuple):
    """What is still open between m predicted rows and M detections."""

    z: np.ndarray
    """(2 m,) predicted pixels, given the matches so far [px]."""
    S: np.ndarray
    """(2 m, 2 m) their joint innovation covariance, given the matches so far [px^2]."""
    inside: np.ndarray
    """(m,) bool: rows whose ellipse is inside the image, as it was predicted."""
    open: np.ndarray
    """(m,) bool: rows without a match."""
    free: np.ndarray
    """(M,) bool: detections without a match."""
    d2: np.ndarray
    """(m, M) squared Mahalanobis distances."""
    cost: np.ndarray
    """(m, M) d^2 + ln |S|: -2 ln of the likelihood, less a constant."""


@part
def associate(
    model: FilterModel,
    rows: np.ndarray,
    predictions: Predictions,
    S: np.ndarray,
    pixels: np.ndarray,
    waits: np.ndarray,
) -> np.ndarray:
    """Match ``pixels`` (M, 2) to ``rows`` (m,); returns (M,) the row of each, or NEW or REJECTED.

    ``predictions`` and ``S`` (2 m, 2 m) are the rows' joint prediction; ``waits`` (K + F,) bool is set for the rows
    that a detection may be of without being clear enough to match.
    """
    m, M = rows.shape[0], pixels.shape[0]
    h = Hypotheses(
        _stacked_pixels(rows, predictions),
        S.copy(),
        predictions.visibility[rows] == INSIDE,
        np.ones(m, np.bool_),
        np.ones(M, np.bool_),
        np.empty((m, M)),
        np.empty((m, M)),
    )
    out = np.full(M, NEW)
    _measure_distances(h, pixels)
    while _any_open(model, h):
        matched = _match_clear(model, h, pixels, rows, out)
        if not matched and not _match_supported(model, h, pixels, rows, out):
            break
    for i in range(M):
        for a in range(m):
            if h.free[i] and h.d2[a, i] < model.birth_gate:
                out[i] = REJECTED
                if h.open[a]:
                    waits[rows[a]] = True
    return out


@part
def _stacked_pixels(rows: np.ndarray, predictions: Predictions) -> np.ndarray:
    """(2 m,) predicted pixels of ``rows``."""
    z = np.empty(2 * rows.shape[0])
    for i in range(z.shape[0]):
        z[i] = predictions.z_hat[rows[i // 2], i % 2]
    return z


@part
def _measure_distances(h: Hypotheses, pixels: np.ndarray) -> None:
    """Distances and costs of the open rows."""
    for a in range(h.open.shape[0]):
        if h.open[a]:
            s00, s01, s11 = h.S[2 * a, 2 * a], h.S[2 * a, 2 * a + 1], h.S[2 * a + 1, 2 * a + 1]
            det = max(s00 * s11 - s01 * s01, 1e-300)
            log_det = math.log(det)
            for i in range(pixels.shape[0]):
                x, y = pixels[i, 0] - h.z[2 * a], pixels[i, 1] - h.z[2 * a + 1]
                h.d2[a, i] = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / det
                h.cost[a, i] = h.d2[a, i] + log_det


@part
def _any_open(model: FilterModel, h: Hypotheses) -> bool:
    """Whether an open row and a free detection may still belong together."""
    for a in range(h.open.shape[0]):
        if h.open[a]:
            for i in range(h.free.shape[0]):
                if h.free[i] and h.d2[a, i] < model.birth_gate:
                    return True
    return False


@part
def _close(h: Hypotheses, a: int, i: int) -> None:
    h.open[a] = False
    h.free[i] = False


@part
def _condition(h: Hypotheses, a: int, pixel: np.ndarray) -> None:
    """Condition the joint Gaussian of the predicted pixels on row ``a`` being seen at ``pixel`` (2,)."""
    n = h.z.shape[0]
    s00, s01, s11 = h.S[2 * a, 2 * a], h.S[2 * a, 2 * a + 1], h.S[2 * a + 1, 2 * a + 1]
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = pixel[0] - h.z[2 * a], pixel[1] - h.z[2 * a + 1]
    c0, c1 = h.S[2 * a].copy(), h.S[2 * a + 1].copy()
    for i in range(n):
        g0, g1 = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det
        h.z[i] += g0 * x + g1 * y
        for j in range(n):
            h.S[i, j] -= g0 * c0[j] + g1 * c1[j]


@part
def _is_sharp(model: FilterModel, h: Hypotheses, a: int) -> bool:
    """Whether the longest axis of row ``a``'s ellipse is within the limit."""
    s00, s01, s11 = h.S[2 * a, 2 * a], h.S[2 * a, 2 * a + 1], h.S[2 * a + 1, 2 * a + 1]
    half = 0.5 * (s00 + s11)
    longest = half + math.sqrt(max(half * half - (s00 * s11 - s01 * s01), 0.0))
    return longest <= model.sharp_std_px**2


@part
def _match_clear(model: FilterModel, h: Hypotheses, pixels: np.ndarray, rows: np.ndarray, out: np.ndarray) -> bool:
    """Match every sharp row that has a clear partner, then condition the rest on them; whether there was any."""
    m = h.open.shape[0]
    partner = np.full(m, -1)
    found = False
    for a in range(m):
        if h.open[a] and _is_sharp(model, h, a):
            partner[a] = _clear_partner(model, h, a)
            found |= partner[a] >= 0
    for a in range(m):
        if partner[a] >= 0:
            out[partner[a]] = rows[a]
            _close(h, a, partner[a])
    if found and _any_open(model, h):
        for a in range(m):
            if partner[a] >= 0:
                _condition(h, a, pixels[partner[a]])
        _measure_distances(h, pixels)
    return found


@part
def _clear_partner(model: FilterModel, h: Hypotheses, a: int) -> int:
    """The free detection that is row ``a``'s best by a margin, and whose best by a margin is row ``a``; or -1."""
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


@part
def _match_supported(model: FilterModel, h: Hypotheses, pixels: np.ndarray, rows: np.ndarray, out: np.ndarray) -> bool:
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
                support = _support(model, h, a, i, pixels)
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
    out[best_i] = rows[best_a]
    _close(h, best_a, best_i)
    _condition(h, best_a, pixels[best_i])
    _measure_distances(h, pixels)
    return True


@part
def _support(model: FilterModel, h: Hypotheses, a: int, i: int, pixels: np.ndarray) -> float:
    """Sum over the other open rows of their best log likelihood ratio, given that row ``a`` is detection ``i``."""
    trial = Hypotheses(h.z.copy(), h.S.copy(), h.inside, h.open.copy(), h.free.copy(), h.d2.copy(), h.cost.copy())
    _close(trial, a, i)
    _condition(trial, a, pixels[i])
    _measure_distances(trial, pixels)
    total = 0.0
    for r in range(trial.open.shape[0]):
        best = 0.0
        for j in range(trial.free.shape[0]):
            if trial.open[r] and trial.free[j] and trial.d2[r, j] < model.gate:
                best = max(best, 0.5 * (model.clutter_cost - trial.cost[r, j]))
        total += best
    return total
