"""How far the covariance update is from what the machine's own BLAS does with as many operations."""

from functools import partial

import numpy as np
from scipy.linalg.blas import dgemm

from activeslam_gym.slam.kalman import update

from .filtering import PointFilter
from .report import Section
from .setups import SEEN
from .timing import dispatch, repeated, restored

LANDMARKS = (27, 39, 100, 300)
M = 2 * SEEN


def run(quick: bool) -> Section:
    """Speed of `update` and of dgemm's W^T W at the same sizes."""
    section = Section("The update beside dgemm")
    count, repeats, at_least = (100, 3, 0.01) if quick else (1000, 9, 0.1)
    for landmarks in LANDMARKS:
        belief = PointFilter(landmarks).belief
        n = int(belief.state.dim)
        flops = 2.0 * M * n * n + M * M * n + 2.0 * M * n
        HP = 1e-6 * np.random.default_rng(0).standard_normal((M, n))
        S, nu = 4.0 * np.eye(M), np.zeros(M)
        arguments = (belief, HP.copy(), S.copy(), nu)

        def restore(work: tuple = arguments, saved: tuple = (HP, S)) -> None:
            np.copyto(work[1], saved[0])
            np.copyto(work[2], saved[1])

        ours = restored(partial(update, *arguments), restore, count).seconds - dispatch(arguments, True, count)
        W = np.asfortranarray(HP)
        blas = repeated(partial(dgemm, 1.0, W, W, trans_a=True), repeats, at_least).seconds
        speed, reference = 1e-9 * flops / ours, 1e-9 * 2.0 * M * n * n / blas
        row = {"n": n, "update [µs]": 1e6 * ours, "update [Gflop/s]": speed, "dgemm [Gflop/s]": reference}
        section.rows.append({**row, "update / dgemm speed": speed / reference})
    section.notes.append(
        f"m = {M}. Update: 2 m n² for P − WᵀW, m² n + 2 m n for W and the mean (its factor of S, recentring and shift "
        "of the mean are timed, not counted), called from Python less an empty call. dgemm: WᵀW by SciPy's BLAS on one "
        "thread, its own call included."
    )
    return section
