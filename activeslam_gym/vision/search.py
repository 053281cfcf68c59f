"""Active search: a predicted template is correlated with the image inside its ellipse, and only there.

The score is the normalised cross-correlation, which neither gain nor brightness changes (NSSD = 2 - 2 NCC). Peaks are
refined below the pixel by Gauss-Newton on I(z + w) = gain T(w) + bias, whose normal equations also tell how well the
patch can be localised: along an edge, badly.
"""

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import View
from activeslam_gym.kernels import Record, borrowing, compiled, record
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE, Templates, predict_appearance

PEAKS = 3  # most candidates of a feature
_COUNT, _INNER = TEMPLATE_SIDE**2, (TEMPLATE_SIDE - 2) ** 2  # pixels of a template, and those that have a gradient
_READ = TEMPLATE_HALF + 4  # pixels around the pixels of an ellipse that are read: the template, and its refinement

SEARCH = record(
    gate="f8",  # the ellipse is d^2 < gate
    least_score="f8",  # a peak under this correlation is no candidate
    largest_area="f8",  # of a larger ellipse, the middle part of this size is searched [px^2]
    floor_std="f8",  # deviation of a pixel that a perfect template would have: lens, timing, the plane [px]
    grain="f8",  # inflation of the covariance of the fit: neighbouring residuals are correlated
)
"""Constants of the search."""


MISSED, MATCHED, DOUBTED = 0, 1, 2
"""Outcomes of a search: nothing similar was found; the filter believed the candidate; the filter did not."""


class Searched(NamedTuple):
    """Where m templates were searched in the last image, and with which outcome."""

    id: np.ndarray  # (m,)
    pixel: np.ndarray  # (m, 2) as predicted [px]
    covariance: np.ndarray  # (m, 2, 2) of that [px^2]
    outcome: np.ndarray  # (m,) MISSED, MATCHED or DOUBTED
    inside: np.ndarray = np.zeros(0, bool)  # (m,) well inside the image, where a miss counts

    @property
    def counts(self) -> tuple[int, int, int]:
        """How many templates were searched, found and matched."""
        return len(self.outcome), int((self.outcome != MISSED).sum()), int((self.outcome == MATCHED).sum())


NOTHING = Searched(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, np.int64))


class Findings(NamedTuple):
    """The result of a search: v rows, up to 3 candidates each, the best first."""

    searched: np.ndarray  # (v,) bool
    peaks: np.ndarray  # (v,) candidates; 0: nothing there is similar
    pixel: np.ndarray  # (v, 3, 2) [px]
    R: np.ndarray  # (v, 3, 2, 2) [px^2]
    score: np.ndarray  # (v, 3) normalised cross-correlation

    @property
    def candidates(self) -> tuple[np.ndarray, np.ndarray]:
        """(M,) the row and the peak of each candidate."""
        row, peak = np.nonzero(np.arange(PEAKS) < self.peaks[:, None])
        return row, peak

    def outcome(self, believed: np.ndarray) -> np.ndarray:
        """(v,) MISSED, MATCHED or DOUBTED, by which rows are ``believed`` (v,) bool."""
        return np.where(believed, MATCHED, np.where(self.peaks > 0, DOUBTED, MISSED))


@compiled
def search(
    view: View, model: Record, templates: Templates, image: np.ndarray, places: np.ndarray, points: np.ndarray,
    z_hat: np.ndarray, S: np.ndarray,
) -> Findings:  # fmt: skip
    """Look for the features at ``points`` (v, 3), whose templates are at ``places`` (v,), in ``image`` (h, w) float32.

    ``z_hat`` (v, 2) and ``S`` (v, 2, 2) are their predicted pixels in ``view``.
    """
    v = places.shape[0]
    searched, peaks, pixel = np.zeros(v, np.bool_), np.zeros(v, np.int64), np.zeros((v, PEAKS, 2))
    out = Findings(searched, peaks, pixel, np.zeros((v, PEAKS, 2, 2)), np.zeros((v, PEAKS)))
    T = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    for a in range(v):
        if (
            places[a] >= 0
            and _is_searchable(image, z_hat[a], S[a])
            and predict_appearance(view, templates, places[a], points[a], T)
            and _normalise(T)
        ):
            _search_one(model, image, T, z_hat[a], S[a], a, out)
    return out


class Photograph:
    """An image that is worked out where it is looked at: ``show`` gives the windows (n, 4) that it is asked for, beside
    which it is black, or all of it (None). A window has first and last column, first and last row."""

    def __init__(self, show: Callable[[np.ndarray | None], np.ndarray]) -> None:
        self.show = show

    @cached_property
    def whole(self) -> np.ndarray:
        """(h, w) uint8."""
        return self.show(None)


@compiled
def windows(model: Record, image: np.ndarray, z_hat: np.ndarray, S: np.ndarray) -> np.ndarray:
    """(n, 4) the windows of an image of that shape which `search` reads for ``z_hat`` (v, 2) and ``S`` (v, 2, 2)."""
    out, n = np.empty((z_hat.shape[0], 4), np.int64), 0
    for a in range(out.shape[0]):
        if _is_searchable(image, z_hat[a], S[a]):
            _, left, right, top, bottom = _ellipse(model, image, z_hat[a], S[a])
            out[n, 0], out[n, 1], out[n, 2], out[n, 3] = left - _READ, right + _READ, top - _READ, bottom + _READ
            n += 1
    return out[:n]


@compiled
def _is_searchable(image: np.ndarray, z: np.ndarray, S: np.ndarray) -> bool:
    """Whether the template fits into the image at ``z``, and there is an ellipse."""
    h, w = image.shape
    edge = TEMPLATE_HALF + 2
    inside = edge <= z[0] < w - edge and edge <= z[1] < h - edge
    return inside and S[0, 0] * S[1, 1] > S[0, 1] * S[1, 0]


@compiled
def _normalise(T: np.ndarray) -> bool:
    """Give a drawn template mean 0 and length 1, its invisible pixels 0; False if there is nothing on it."""
    values = T.reshape(_COUNT)
    total, seen = 0.0, 0
    for k in range(_COUNT):
        if not math.isnan(values[k]):
            total += values[k]
            seen += 1
    mean, square = total / max(seen, 1), 0.0
    for k in range(_COUNT):
        values[k] = 0.0 if math.isnan(values[k]) else values[k] - mean
        square += values[k] * values[k]
    if square < 25.0 * _COUNT:  # a standard deviation of 5 grey levels
        return False
    scale = 1.0 / math.sqrt(square)
    for k in range(_COUNT):
        values[k] *= scale
    return True


@compiled
def integrals(image: np.ndarray) -> np.ndarray:
    """(2, h + 1, w + 1): sums of the grey values, and of their squares, of all pixels above and left of each."""
    h, w = image.shape
    out = np.zeros((2, h + 1, w + 1))
    for i in range(h):
        total, square = 0.0, 0.0
        for j in range(w):
            value = float(image[i, j])
            total += value
            square += value * value
            out[0, i + 1, j + 1] = out[0, i, j + 1] + total
            out[1, i + 1, j + 1] = out[1, i, j + 1] + square
    return out


@compiled(fastmath={"contract"})
def _cross(image: np.ndarray, T: np.ndarray, top: int, left: int, out: np.ndarray) -> None:
    """out[x] = sum of T times the window of ``image`` whose first pixel is (left + x, top). The front end's hot loop.

    Five products to a pass: the sums stay in registers, and neighbouring windows go through vector instructions.
    """
    n = out.shape[0]
    for x in range(n):
        out[x] = np.float32(0.0)
    for i in range(TEMPLATE_SIDE):
        for j in range(0, TEMPLATE_SIDE, 5):
            line = image[top + i, left + j : left + j + n + 4]
            a, b, c, d, e = T[i, j], T[i, j + 1], T[i, j + 2], T[i, j + 3], T[i, j + 4]
            for x in range(n):
                out[x] += a * line[x] + b * line[x + 1] + c * line[x + 2] + d * line[x + 3] + e * line[x + 4]


@compiled
def _correlate_row(image: np.ndarray, sums: np.ndarray, T: np.ndarray, top: int, left: int, out: np.ndarray) -> None:
    """Normalised cross-correlations (n,) of ``T`` (zero mean, length 1) with windows of ``image``, see `_cross`."""
    n = out.shape[0]
    _cross(image, T, top, left, out)
    bottom = top + TEMPLATE_SIDE
    for x in range(n):
        i, j = left + x, left + x + TEMPLATE_SIDE
        total = sums[0, bottom, j] - sums[0, bottom, i] - sums[0, top, j] + sums[0, top, i]
        square = sums[1, bottom, j] - sums[1, bottom, i] - sums[1, top, j] + sums[1, top, i]
        spread = square - total * total / _COUNT
        out[x] = out[x] / math.sqrt(spread) if spread > _COUNT else 0.0


@compiled
def _ellipse(model: Record, image: np.ndarray, z: np.ndarray, S: np.ndarray) -> tuple[float, int, int, int, int]:
    """The gate of the ellipse around ``z`` that is searched, its first and last column, its first and last row."""
    (h, w), edge = image.shape, TEMPLATE_HALF + 1
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    gate = min(model.gate, model.largest_area / (math.pi * math.sqrt(det)))
    reach_x, reach_y = math.sqrt(gate * S[0, 0]), math.sqrt(gate * S[1, 1])
    left, right = max(edge, int(math.ceil(z[0] - reach_x))), min(w - 1 - edge, int(math.floor(z[0] + reach_x)))
    top, bottom = max(edge, int(math.ceil(z[1] - reach_y))), min(h - 1 - edge, int(math.floor(z[1] + reach_y)))
    return gate, left, right, top, bottom


@compiled
def _search_one(
    model: Record, image: np.ndarray, T: np.ndarray, z: np.ndarray, S: np.ndarray, a: int, out: Findings
) -> None:
    """Correlate ``T`` over the ellipse around ``z``; row ``a`` of ``out`` gets its peaks."""
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    gate, left, right, top, bottom = _ellipse(model, image, z, S)
    scores = np.full((max(bottom - top + 3, 3), max(right - left + 3, 3)), np.float32(-1.0))
    part = image[top - TEMPLATE_HALF : bottom + TEMPLATE_HALF + 1, left - TEMPLATE_HALF : right + TEMPLATE_HALF + 1]
    sums = integrals(part)
    for row in range(top, bottom + 1):  # the chord of the ellipse d^2 < gate at this row
        y = row - z[1]
        middle = z[0] + S[0, 1] / S[1, 1] * y
        half = math.sqrt(max(det * (gate * S[1, 1] - y * y), 0.0)) / S[1, 1]
        first, last = max(left, int(math.ceil(middle - half))), min(right, int(math.floor(middle + half)))
        if first <= last:
            to = scores[row - top + 1, first - left + 1 : last - left + 2]
            _correlate_row(part, sums, T, row - top, first - left, to)
    out.searched[a] = True
    _keep_peaks(model, scores, out, a)
    for k in range(out.peaks[a]):
        out.pixel[a, k, 0] += left - 1
        out.pixel[a, k, 1] += top - 1
        _localise(model, image, T, out, a, k)


@compiled
def _keep_peaks(model: Record, scores: np.ndarray, out: Findings, a: int) -> None:
    """The best local maxima of ``scores``, as (column, row) of the array."""
    for i in range(1, scores.shape[0] - 1):
        for j in range(1, scores.shape[1] - 1):
            score = scores[i, j]
            if score < model.least_score or (out.peaks[a] == PEAKS and score <= out.score[a, PEAKS - 1]):
                continue
            highest = True
            for k in range(9):
                di, dj = k // 3 - 1, k % 3 - 1
                other = scores[i + di, j + dj]
                highest &= other < score or (other == score and k >= 4)
            if not highest:
                continue
            at = min(out.peaks[a], PEAKS - 1)
            while at > 0 and out.score[a, at - 1] < score:
                out.score[a, at] = out.score[a, at - 1]
                out.pixel[a, at, 0], out.pixel[a, at, 1] = out.pixel[a, at - 1, 0], out.pixel[a, at - 1, 1]
                at -= 1
            out.score[a, at], out.pixel[a, at, 0], out.pixel[a, at, 1] = score, j, i
            out.peaks[a] = min(out.peaks[a] + 1, PEAKS)


@compiled
def _localise(model: Record, image: np.ndarray, T: np.ndarray, out: Findings, a: int, peak: int) -> None:
    """Refine a pixel (2,) of ``out`` by Gauss-Newton and write its covariance R (2, 2) [px^2].

    With J = [dT/dx, dT/dy] and the residual r = (I - mean I) / |I - mean I| - T, both of length about 1:
    d = -(J^T J)^-1 J^T r (inverse composition: the patch in the image is T shifted by d), and
    R = floor^2 I + grain (r^T r / n) (J^T J)^-1.
    """
    J, g = np.zeros((TEMPLATE_SIDE, TEMPLATE_SIDE, 2)), np.zeros(2)
    pixel, R = out.pixel[a, peak], out.R[a, peak]
    A00, A01, A11 = 1e-6, 0.0, 1e-6
    for i in range(1, TEMPLATE_SIDE - 1):
        for j in range(1, TEMPLATE_SIDE - 1):
            gx, gy = _gradient(T, i, j)
            J[i, j, 0], J[i, j, 1] = gx, gy
            A00 += gx * gx
            A01 += gx * gy
            A11 += gy * gy
    det = A00 * A11 - A01 * A01
    start_x, start_y, residual = pixel[0], pixel[1], 0.0
    for step in range(4):
        residual = _misfit(image, T, J, pixel, g)
        dx, dy = (A11 * g[0] - A01 * g[1]) / det, (A00 * g[1] - A01 * g[0]) / det
        if step == 3 or not abs(dx) + abs(dy) >= 0.005:
            break
        pixel[0] -= dx
        pixel[1] -= dy
    if math.isnan(residual) or not (abs(pixel[0] - start_x) <= 1.0 and abs(pixel[1] - start_y) <= 1.0):
        pixel[0], pixel[1], residual = start_x, start_y, 0.5
    var, floor = model.grain * residual / _COUNT, model.floor_std**2
    R[0, 0], R[0, 1], R[1, 1] = floor + var * A11 / det, -var * A01 / det, floor + var * A00 / det
    R[1, 0] = R[0, 1]


@borrowing
def _gradient(T: np.ndarray, i: int, j: int) -> tuple[float, float]:
    """dT/dx and dT/dy; zero at a pixel that is not seen, and beside one: what is not seen has no edge."""
    if T[i, j] == 0.0 or T[i, j - 1] == 0.0 or T[i, j + 1] == 0.0 or T[i - 1, j] == 0.0 or T[i + 1, j] == 0.0:
        return 0.0, 0.0
    return 0.5 * (T[i, j + 1] - T[i, j - 1]), 0.5 * (T[i + 1, j] - T[i - 1, j])


@compiled
def _misfit(image: np.ndarray, T: np.ndarray, J: np.ndarray, pixel: np.ndarray, g: np.ndarray) -> float:
    """r^T r of the image around ``pixel``, against ``T`` where it is seen, as of all of T; J^T r into ``g`` (2,)."""
    total, square, seen = 0.0, 0.0, 0
    column, row = math.floor(pixel[0]), math.floor(pixel[1])
    h, w = image.shape
    edge = TEMPLATE_HALF + 1
    if not (edge <= column < w - 1 - edge and edge <= row < h - 1 - edge):
        return np.nan
    values = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE))
    a, b = pixel[0] - column, pixel[1] - row
    w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
    for i in range(TEMPLATE_SIDE):
        upper = image[int(row) - TEMPLATE_HALF + i, int(column) - TEMPLATE_HALF :]
        lower = image[int(row) - TEMPLATE_HALF + i + 1, int(column) - TEMPLATE_HALF :]
        for j in range(TEMPLATE_SIDE):
            value = w00 * upper[j] + w01 * upper[j + 1] + w10 * lower[j] + w11 * lower[j + 1]
            values[i, j] = value
            if T[i, j] != 0.0:
                total += value
                square += value * value
                seen += 1
    mean = total / max(seen, 1)
    scale = 1.0 / math.sqrt(max(square - total * mean, 1.0))
    residual, inner, g0, g1 = 0.0, 0, 0.0, 0.0
    for i in range(1, TEMPLATE_SIDE - 1):
        for j in range(1, TEMPLATE_SIDE - 1):
            if T[i, j] != 0.0:
                r = (values[i, j] - mean) * scale - T[i, j]
                g0 += J[i, j, 0] * r
                g1 += J[i, j, 1] * r
                residual += r * r
                inner += 1
    g[0], g[1] = g0, g1
    return residual * (_INNER / max(inner, 1))
