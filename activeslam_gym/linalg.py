"""The one home of factorising: small dense kernels that run inside one thread and do not call BLAS.

Inner loops run along rows, so that they vectorise without reordering a sum: the result does not depend on the caller.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cholesky_in_place(A: np.ndarray) -> bool:
    """Factor the symmetric ``A`` (n, n) as U^T U; U overwrites the upper triangle. False if not positive definite."""
    n = A.shape[0]
    for k in range(n):
        pivot = A[k, k]
        if not (pivot > 0.0 and pivot < np.inf):  # catches NaN too
            return False
        root = math.sqrt(pivot)
        A[k, k] = root
        inverse = 1.0 / root
        for j in range(k + 1, n):
            A[k, j] *= inverse
        for i in range(k + 1, n):
            factor = A[k, i]
            if factor != 0.0:
                for j in range(i, n):
                    A[i, j] -= factor * A[k, j]
    return True


@njit(cache=True)
def log2_det_of_factor(U: np.ndarray, start: int, stop: int) -> float:
    """log2 of the squared product of the diagonal entries ``start`` to ``stop`` of a factor: of a determinant."""
    total = 0.0
    for i in range(start, stop):
        total += math.log2(U[i, i])
    return 2.0 * total


@njit(cache=True)
def solve_transposed(U: np.ndarray, B: np.ndarray) -> None:
    """Overwrite ``B`` (n, m) with U^{-T} B."""
    n, m = B.shape
    for i in range(n):
        for k in range(i):
            factor = U[k, i]
            if factor != 0.0:
                for j in range(m):
                    B[i, j] -= factor * B[k, j]
        inverse = 1.0 / U[i, i]
        for j in range(m):
            B[i, j] *= inverse


@njit(cache=True)
def log2_det(A: np.ndarray) -> float:
    """log2 |A| of a symmetric matrix (n, n), or NaN where it is not positive definite."""
    U = A.copy()
    if not cholesky_in_place(U):
        return np.nan
    return log2_det_of_factor(U, 0, U.shape[0])


@njit(cache=True)
def subtract_gram(P: np.ndarray, W: np.ndarray, n: int) -> None:
    """P[:n, :n] -= W^T W with W (m, >= n). Both triangles get the same operations, so P stays symmetric to the bit."""
    m = W.shape[0]
    for i in range(n):
        row = P[i]
        for r in range(m):
            factor = W[r, i]
            if factor != 0.0:
                for j in range(n):
                    row[j] -= factor * W[r, j]
