"""Which of the features in view to search, where the time is not enough for all: those that tell most, together."""

import math

import numpy as np

from activeslam_gym.kernels import compiled


def among(ids: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(n,) whether each of the ``ids`` (n,) is one of the ``others`` (m,)."""
    return np.any(ids[:, None] == others, axis=1)


def own_covariances(S: np.ndarray) -> np.ndarray:
    """(v, 2, 2) each prediction's own block of the joint ``S`` (2 v, 2 v)."""
    v = len(S) // 2
    return S.reshape(v, 2, v, 2)[np.arange(v), :, np.arange(v), :]


@compiled
def most_telling(S: np.ndarray, R: np.ndarray, allowed: np.ndarray, count: int) -> np.ndarray:
    """(v,) bool: ``count`` of the ``allowed`` (v,) predictions, or all if there are fewer, chosen one by one.

    The next is that with the greatest mutual information of its pixel and the estimate, given those chosen before:
    1/2 log (det S_aa / det R_a), S_aa the part of ``S`` (2 v, 2 v) = H P H^T + R that they leave (Davison 2005). ``R``
    (v, 2, 2) is the noise of each by itself.
    """
    v, m = allowed.shape[0], 2 * min(count, int(np.sum(allowed)))
    chosen, own, W = np.zeros(v, np.bool_), np.empty((v, 2, 2)), np.empty((m, 2 * v))
    for a in range(v):
        own[a] = S[2 * a : 2 * a + 2, 2 * a : 2 * a + 2]
    for k in range(0, m, 2):
        best, most = -1, -math.inf
        for a in range(v):
            if allowed[a] and not chosen[a]:
                ratio = (own[a, 0, 0] * own[a, 1, 1] - own[a, 0, 1] ** 2) / (R[a, 0, 0] * R[a, 1, 1] - R[a, 0, 1] ** 2)
                if ratio > most:
                    best, most = a, ratio
        chosen[best] = True
        first, second = W[k], W[k + 1]  # rows of the factor of S, of the predictions in the order of their choice
        for i in range(2 * v):
            first[i], second[i] = S[2 * best, i], S[2 * best + 1, i]
        for j in range(k):
            x, y = W[j, 2 * best], W[j, 2 * best + 1]
            for i in range(2 * v):
                first[i] -= x * W[j, i]
                second[i] -= y * W[j, i]
        scale = 1.0 / math.sqrt(own[best, 0, 0])
        share = own[best, 0, 1] / own[best, 0, 0]
        rest = 1.0 / math.sqrt(own[best, 1, 1] - share * own[best, 0, 1])
        for i in range(2 * v):
            second[i] = rest * (second[i] - share * first[i])
            first[i] *= scale
        for a in range(v):
            for p in range(2):
                for q in range(2):
                    for row in (first, second):
                        own[a, p, q] -= row[2 * a + p] * row[2 * a + q]
    return chosen
