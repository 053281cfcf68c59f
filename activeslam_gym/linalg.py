"""The one home of factorising: small dense kernels that run inside one thread and do not call BLAS.

Inner loops run along rows, so that they vectorise without reordering a sum: the result does not depend on the caller.
They begin at 0, of slices: with another start the compiler cannot know that no index is negative, and does one element
at a time.
"""

import math

import numpy as np

from activeslam_gym.kernels import borrowing, compiled

_FUSE = {"contract"}  # let a product and a sum become one fused operation; sums are never reordered


@borrowing(fastmath=_FUSE)
def cholesky_in_place(A: np.ndarray) -> bool:
    """Factor the symmetric ``A`` (n, n) as U^T U; U overwrites the upper triangle. False if not positive definite.

    Four rows at a time, of which all rows above are subtracted first. Entries below the diagonal are not read, and
    mean nothing afterwards.
    """
    n = A.shape[0]
    for top in range(0, n, 4):
        bottom = min(top + 4, n)
        _subtract_from_rows(A, top, bottom, A, A, top, top, n)
        for i in range(top, bottom):
            row = A[i, i:]
            for k in range(top, i):
                done = A[k, i:]
                factor = done[0]
                for j in range(n - i):
                    row[j] -= factor * done[j]
            pivot = row[0]
            if not (pivot > 0.0 and pivot < np.inf):  # catches NaN too
                return False
            inverse = 1.0 / math.sqrt(pivot)
            for j in range(n - i):
                row[j] *= inverse
    return True


@borrowing(fastmath=_FUSE)
def _subtract_from_rows(
    A: np.ndarray, top: int, bottom: int, F: np.ndarray, W: np.ndarray, m: int, start: int, stop: int
) -> None:
    """A[i] -= sum of F[k, i] W[k] over k < ``m``, columns ``start`` to ``stop``, for i from ``top`` to ``bottom``."""
    if bottom == top + 4:
        _subtract_from_four(A, top, F, W, m, start, stop)
    else:
        for i in range(top, bottom):
            subtract_from_one(A, i, F, W, m, start, stop)


@borrowing(fastmath=_FUSE)
def _subtract_from_four(A: np.ndarray, i: int, F: np.ndarray, W: np.ndarray, m: int, start: int, stop: int) -> None:
    """`_subtract_from_rows` of rows i … i + 3.

    Four k at a time, and the rest one by one. Each number of W is loaded once for four rows, and each row once for
    four k: this takes most of the time of a frame.
    """
    whole = m - m % 4
    a0, a1, a2, a3 = A[i, start:stop], A[i + 1, start:stop], A[i + 2, start:stop], A[i + 3, start:stop]
    for k in range(0, whole, 4):
        w0, w1, w2, w3 = W[k, start:stop], W[k + 1, start:stop], W[k + 2, start:stop], W[k + 3, start:stop]
        f00, f10, f20, f30 = F[k, i], F[k + 1, i], F[k + 2, i], F[k + 3, i]
        f01, f11, f21, f31 = F[k, i + 1], F[k + 1, i + 1], F[k + 2, i + 1], F[k + 3, i + 1]
        f02, f12, f22, f32 = F[k, i + 2], F[k + 1, i + 2], F[k + 2, i + 2], F[k + 3, i + 2]
        f03, f13, f23, f33 = F[k, i + 3], F[k + 1, i + 3], F[k + 2, i + 3], F[k + 3, i + 3]
        for j in range(stop - start):
            x0, x1, x2, x3 = w0[j], w1[j], w2[j], w3[j]
            a0[j] = a0[j] - f00 * x0 - f10 * x1 - f20 * x2 - f30 * x3
            a1[j] = a1[j] - f01 * x0 - f11 * x1 - f21 * x2 - f31 * x3
            a2[j] = a2[j] - f02 * x0 - f12 * x1 - f22 * x2 - f32 * x3
            a3[j] = a3[j] - f03 * x0 - f13 * x1 - f23 * x2 - f33 * x3
    for k in range(whole, m):
        w, f0, f1, f2, f3 = W[k, start:stop], F[k, i], F[k, i + 1], F[k, i + 2], F[k, i + 3]
        for j in range(stop - start):
            x = w[j]
            a0[j] -= f0 * x
            a1[j] -= f1 * x
            a2[j] -= f2 * x
            a3[j] -= f3 * x


@borrowing(fastmath=_FUSE)
def subtract_from_one(A: np.ndarray, i: int, F: np.ndarray, W: np.ndarray, m: int, start: int, stop: int) -> None:
    """A[i] -= sum of F[k, i] W[k] over k < ``m``, columns ``start`` to ``stop``, four at a time."""
    row, whole = A[i, start:stop], m - m % 4
    for k in range(0, whole, 4):
        w0, w1, w2, w3 = W[k, start:stop], W[k + 1, start:stop], W[k + 2, start:stop], W[k + 3, start:stop]
        f0, f1, f2, f3 = F[k, i], F[k + 1, i], F[k + 2, i], F[k + 3, i]
        for j in range(stop - start):
            row[j] = row[j] - f0 * w0[j] - f1 * w1[j] - f2 * w2[j] - f3 * w3[j]
    for k in range(whole, m):
        w, f0 = W[k, start:stop], F[k, i]
        for j in range(stop - start):
            row[j] -= f0 * w[j]


@borrowing
def log2_det_of_factor(U: np.ndarray, start: int, stop: int) -> float:
    """log2 of the squared product of the diagonal entries ``start`` to ``stop`` of a factor: of a determinant."""
    total = 0.0
    for i in range(start, stop):
        total += math.log2(U[i, i])
    return 2.0 * total


@borrowing(fastmath=_FUSE)
def solve_transposed(U: np.ndarray, B: np.ndarray) -> None:
    """Overwrite ``B`` (n, m) with U^{-T} B."""
    n, m = B.shape
    for top in range(0, n, 4):
        bottom = min(top + 4, n)
        _subtract_from_rows(B, top, bottom, U, B, top, 0, m)
        for i in range(top, bottom):
            row, inverse = B[i], 1.0 / U[i, i]
            for k in range(top, i):
                factor, done = U[k, i], B[k]
                for j in range(m):
                    row[j] -= factor * done[j]
            for j in range(m):
                row[j] *= inverse


@borrowing(fastmath=_FUSE)
def solve_transposed_vector(U: np.ndarray, b: np.ndarray) -> None:
    """Overwrite the vector ``b`` (n,) with U^{-T} b; U may have more rows than b."""
    n = b.shape[0]
    for k in range(n):
        b[k] /= U[k, k]
        factor, rest, row = b[k], b[k + 1 :], U[k, k + 1 :]
        for j in range(n - k - 1):
            rest[j] -= factor * row[j]


@compiled
def log2_det(A: np.ndarray) -> float:
    """log2 |A| of a symmetric matrix (n, n), or NaN where it is not positive definite."""
    U = A.copy()
    if not cholesky_in_place(U):
        return np.nan
    return log2_det_of_factor(U, 0, U.shape[0])


@borrowing(fastmath=_FUSE)
def subtract_symmetric(P: np.ndarray, V: np.ndarray, W: np.ndarray, n: int) -> None:
    """P[:n, :n] -= V^T W which is symmetric as P is; V, W (m, >= n): the upper triangle, whose copy is the lower."""
    subtract_from_upper(P, V, W, n)
    for i in range(1, n):
        for j in range(i):
            P[i, j] = P[j, i]


@borrowing(fastmath=_FUSE)
def subtract_from_upper(P: np.ndarray, V: np.ndarray, W: np.ndarray, n: int) -> None:
    """`subtract_symmetric` of the upper triangle alone."""
    m, odd = W.shape[0], n % 4
    for i in range(odd):
        subtract_from_one(P, i, V, W, m, i, n)
    for i in range(odd, n, 4):  # the rows of P once, and those of W, which are fewer, again and again
        _subtract_from_four(P, i, V, W, m, i, n)


@borrowing
def log2_det_3(A: np.ndarray) -> float:
    """log2 |A| of a symmetric 3 x 3 matrix in closed form, or NaN where the determinant is not positive."""
    det = (
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1])
        - A[0, 1] * (A[1, 0] * A[2, 2] - A[1, 2] * A[2, 0])
        + A[0, 2] * (A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0])
    )
    return math.log2(det) if det > 0.0 else np.nan


@borrowing
def squared_distance(s00: float, s01: float, s11: float, u: float, v: float) -> tuple[float, float]:
    """((u, v) S^-1 (u, v)^T, |S|) for the symmetric S = (s00, s01; s01, s11); |S| is at least 1e-300."""
    det = max(s00 * s11 - s01 * s01, 1e-300)
    return (s11 * u * u - 2.0 * s01 * u * v + s00 * v * v) / det, det


@borrowing(fastmath=_FUSE)
def add_product(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """out += A B, for A (n, >= k) and B (k, >= m), ``out`` (>= n, m). Zeros of A cost nothing."""
    for i in range(A.shape[0]):
        target = out[i]
        for k in range(B.shape[0]):
            factor, source = A[i, k], B[k]
            if factor != 0.0:
                for j in range(out.shape[1]):
                    target[j] += factor * source[j]


@borrowing(fastmath=_FUSE)
def add_product_of_two(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """`add_product` of A (2, >= k): both rows at once and three of B at a time, which are a vector's."""
    upper, lower = out[0], out[1]
    whole = B.shape[0] - B.shape[0] % 3
    for k in range(0, whole, 3):
        b0, b1, b2 = B[k], B[k + 1], B[k + 2]
        f0, f1, f2, g0, g1, g2 = A[0, k], A[0, k + 1], A[0, k + 2], A[1, k], A[1, k + 1], A[1, k + 2]
        for j in range(out.shape[1]):
            x0, x1, x2 = b0[j], b1[j], b2[j]
            upper[j] = upper[j] + f0 * x0 + f1 * x1 + f2 * x2
            lower[j] = lower[j] + g0 * x0 + g1 * x1 + g2 * x2
    for k in range(whole, B.shape[0]):
        b, f, g = B[k], A[0, k], A[1, k]
        for j in range(out.shape[1]):
            upper[j] += f * b[j]
            lower[j] += g * b[j]


@compiled
def submatrix(A: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """A[rows][:, rows]: those rows (k,) and the same columns."""
    out = np.empty((rows.shape[0], rows.shape[0]))
    for i in range(rows.shape[0]):
        source, target = A[rows[i]], out[i]
        for j in range(rows.shape[0]):
            target[j] = source[rows[j]]
    return out


@compiled
def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A B."""
    out = np.zeros((A.shape[0], B.shape[1]))
    add_product(A, B, out)
    return out


@compiled
def diagonal(values: np.ndarray) -> np.ndarray:
    """The matrix (n, n) with ``values`` (n,) on its diagonal. Numba compiles eight functions for NumPy's."""
    out = np.zeros((values.shape[0], values.shape[0]))
    for i in range(values.shape[0]):
        out[i, i] = values[i]
    return out


@compiled
def congruence(F: np.ndarray, P: np.ndarray) -> np.ndarray:
    """F P F^T for a symmetric ``P``, symmetric to the bit."""
    out = np.zeros((F.shape[0], F.shape[0]))
    add_symmetric_product(product(F, P), F, out)
    return out


@compiled
def add_symmetric_product(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """out += A B^T (n, n) where that is symmetric: one triangle, from the lower one of ``out``; A, B (>= n, k).

    Zeros of B cost nothing.
    """
    n, turned = out.shape[0], np.empty((B.shape[1], out.shape[0]))
    for i in range(n):
        for k in range(turned.shape[0]):
            turned[k, i] = A[i, k]
    for j in range(n):
        row = out[j, j:]
        for i in range(1, n - j):
            row[i] = out[j + i, j]
        for k in range(turned.shape[0]):
            factor, other = B[j, k], turned[k, j:]
            if factor != 0.0:
                for i in range(n - j):
                    row[i] += factor * other[i]
        for i in range(1, n - j):
            out[j + i, j] = row[i]


@borrowing
def copy_into(out: np.ndarray, values: np.ndarray) -> None:
    """out = ``values`` (n,). Written out, since Numba compiles ten functions for the assignment to a slice."""
    for i in range(values.shape[0]):
        out[i] = values[i]


@borrowing
def copy_block(source: np.ndarray, out: np.ndarray) -> None:
    """out = ``source`` (n, m); ``out`` may have more rows."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]


@borrowing
def sum_of_squares(v: np.ndarray) -> float:
    """v^T v of a vector (n,)."""
    total = 0.0
    for x in v:
        total += x * x
    return total
