"""Association of identified candidates: somebody looked for each thing where it was predicted, and found likenesses.

A candidate bears the id of the one thing that it may be, and a log likelihood ratio of its looks. What is left to ask
is which candidates belong together. Its worth is the log likelihood ratio against a stranger of the same looks, of
which there is one in every A pixels that are searched,

    log_ratio + ln N(z; z_hat, S_c) - ln(1 / A) = log_ratio + ln(A / (2 pi sqrt|S_c|)) - d^2 / 2,

with S_c the innovation covariance of the thing given what has been accepted so far. The density of strangers is by the
pixel: one stranger in every ellipse, whatever its size, would be too kind to large ellipses.

1. Every candidate votes as if it were the only one known: its own worth and, given it, each other thing's best. One
   point tells most of the camera's motion (Civera, Grasa, Davison and Montiel, "1-point RANSAC for EKF filtering",
   2010; here nothing is left to chance, since all are tried). The first vote is accepted.
2. Then the worthiest candidate given all that are accepted, until none inside the gate is worth more than nothing.
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, compiled, filled, record
from activeslam_gym.linalg import squared_distance
from activeslam_gym.slam.association import REJECTED, chi_square_2_quantile
from activeslam_gym.slam.hypotheses import Predicted, condition, innovation_with
from activeslam_gym.slam.sight import Sight

APPEARANCE = record(
    search_gate="f8",  # chi-square bound of the first candidate: what is searched is an ellipse of 3 sigma
    gate="f8",  # and of each further one, given those accepted
    stranger_area="f8",  # pixels searched for one stranger that looks enough like a thing to be a candidate [px^2]
)
"""Constants of the association of identified candidates."""


def appearance_of(scenario: Scenario) -> Record:
    """The APPEARANCE record of a scenario."""
    gate = chi_square_2_quantile(scenario.gate_probability)
    return filled(APPEARANCE, search_gate=11.8, gate=gate, stranger_area=500.0)


@compiled
def associate_identified(
    model: Record, pixel_var: float, sight: Sight, candidates: np.ndarray, least: int
) -> np.ndarray:
    """Match ``candidates`` (M,) that bear ids to the things in ``sight`` (v,); none, if fewer than ``least`` agree.

    Returns (v,) the candidate of each thing, or -1, and sets ``candidates.match``: the id, or REJECTED. ``pixel_var``
    is that of the R in ``sight.S``.
    """
    v, M = sight.thing.shape[0], candidates.shape[0]
    h = Predicted(np.empty(2 * v), sight.S.copy())
    of_candidate, of_thing, others, count = np.full(M, -1), np.full(v, -1), np.ones(v, np.bool_), 0
    for a in range(v):
        h.z[2 * a], h.z[2 * a + 1] = sight.thing[a].z_hat[0], sight.thing[a].z_hat[1]
        for i in range(M):
            if candidates[i].id == sight.thing[a].id:
                of_candidate[i] = a
    best = _first(model, h, candidates, of_candidate, pixel_var)
    while best >= 0:
        a = of_candidate[best]
        of_thing[a], others[a], count = best, False, count + 1
        condition(h, others, a, candidates[best], pixel_var)
        best = _next(model, h, candidates, of_candidate, of_thing, pixel_var)
    if count < least:
        of_thing[:] = -1
    for i in range(M):
        a = of_candidate[i]
        candidates[i].match = candidates[i].id if a >= 0 and of_thing[a] == i else REJECTED
    return of_thing


@compiled
def _first(model: Record, h: Predicted, candidates: np.ndarray, of_candidate: np.ndarray, pixel_var: float) -> int:
    """The candidate with the greatest vote, or -1 where no vote is positive."""
    best, most = -1, 0.0
    for i in range(candidates.shape[0]):
        if of_candidate[i] < 0:
            continue
        d2, worth = _worth_alone(model, h, of_candidate[i], candidates[i], pixel_var)
        if d2 < model.search_gate:
            vote = worth + _agreement(model, h, candidates, of_candidate, i, pixel_var)
            if vote > most:
                best, most = i, vote
    return best


@compiled
def _next(
    model: Record,
    h: Predicted,
    candidates: np.ndarray,
    of_candidate: np.ndarray,
    of_thing: np.ndarray,
    pixel_var: float,
) -> int:
    """The worthiest candidate of the things without one, or -1 where none is inside the gate and worth anything."""
    best, most = -1, 0.0
    for i in range(candidates.shape[0]):
        a = of_candidate[i]
        if a >= 0 and of_thing[a] < 0:
            d2, worth = _worth_alone(model, h, a, candidates[i], pixel_var)
            if d2 < model.gate and worth > most:
                best, most = i, worth
    return best


@compiled
def _agreement(
    model: Record, h: Predicted, candidates: np.ndarray, of_candidate: np.ndarray, seed: int, pixel_var: float
) -> float:
    """Sum over the other things of the worth of their best candidate, given that the ``seed`` is what it may be."""
    best = np.zeros(h.z.shape[0] // 2)
    for i in range(candidates.shape[0]):
        b = of_candidate[i]
        if b >= 0 and b != of_candidate[seed]:
            worth = _worth_given(model, h, of_candidate[seed], candidates[seed], b, candidates[i], pixel_var)
            best[b] = max(best[b], worth)
    return best.sum()


@compiled
def _worth_alone(model: Record, h: Predicted, a: int, candidate: Record, pixel_var: float) -> tuple[float, float]:
    """Squared Mahalanobis distance and worth of a candidate of thing ``a``."""
    s00, s01, s11 = innovation_with(h, a, candidate, pixel_var)
    x, y = candidate.pixel[0] - h.z[2 * a], candidate.pixel[1] - h.z[2 * a + 1]
    return _worth(model, candidate, x, y, s00, s01, s11)


@compiled
def _worth_given(
    model: Record, h: Predicted, a: int, seed: Record, b: int, candidate: Record, pixel_var: float
) -> float:
    """Worth of a candidate of thing ``b`` if ``a`` is seen as ``seed``: S_b - G S_ab and z_b + G nu_a, G = S_ba S_a^-1.

    What `condition` does to all things, done to one.
    """
    s00, s01, s11 = innovation_with(h, a, seed, pixel_var)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = seed.pixel[0] - h.z[2 * a], seed.pixel[1] - h.z[2 * a + 1]
    p, q = h.S[2 * b, 2 * a], h.S[2 * b, 2 * a + 1]
    r, t = h.S[2 * b + 1, 2 * a], h.S[2 * b + 1, 2 * a + 1]
    g00, g01 = (s11 * p - s01 * q) / det, (s00 * q - s01 * p) / det
    g10, g11 = (s11 * r - s01 * t) / det, (s00 * t - s01 * r) / det
    e00, e01, e11 = innovation_with(h, b, candidate, pixel_var)
    u = candidate.pixel[0] - h.z[2 * b] - g00 * x - g01 * y
    w = candidate.pixel[1] - h.z[2 * b + 1] - g10 * x - g11 * y
    e00, e01, e11 = e00 - (g00 * p + g01 * q), e01 - (g00 * r + g01 * t), e11 - (g10 * r + g11 * t)
    return _worth(model, candidate, u, w, e00, e01, e11)[1]


@compiled
def _worth(
    model: Record, candidate: Record, x: float, y: float, s00: float, s01: float, s11: float
) -> tuple[float, float]:
    """d^2 of the innovation (x, y) and the worth; see the module."""
    d2, det = squared_distance(s00, s01, s11, x, y)
    return d2, candidate.log_ratio + math.log(model.stranger_area / (2.0 * math.pi)) - 0.5 * (math.log(det) + d2)
