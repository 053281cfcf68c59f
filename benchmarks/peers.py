"""The same filtering by others: filterpy's EKF, and our update written plainly in NumPy."""

from functools import partial
from importlib.util import find_spec
from timeit import repeat
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from activeslam_gym import Gaze, Motion
from activeslam_gym.motion import CAMERA_DIM, COMMANDS

from .setups import SEEN, Call, demand_matches, mapped_runs, repeated, restoring, whole_frames

LANDMARKS = {93: 27, 129: 39}  # n = 12 + 3 landmarks
FRAMES = 5  # frames of a step: a decision every 0.25 s
M = 2 * SEEN


def run(quick: bool) -> tuple[list[dict[str, Any]], str]:
    """Each at both sizes, as a ratio to filterpy's."""
    rows: list[dict[str, Any]] = []
    repeats, at_least, count = (3, 0.02, 100) if quick else (9, 0.2, 1000)
    for n, landmarks in LANDMARKS.items():
        runs, command = mapped_runs(landmarks), COMMANDS[Motion.FORWARD, Gaze.LEFT]
        times, restore = dict[str, float](), restoring(runs)
        for name, frames in (("a whole frame of ours, without entropy", FRAMES), ("the same, one frame a call", 1)):
            call = partial(whole_frames, runs, command, frames)
            times[name] = float(np.median(repeat(call, restore, number=1, repeat=count))) / frames
        demand_matches(runs, landmarks)
        peers = {"predict + update of ours in plain NumPy": plain_numpy(n)}
        if find_spec("filterpy"):
            peers["filterpy EKF predict + update"] = filterpy_step(n)
        times |= {name: float(np.median(repeated(call, repeats, at_least))) for name, call in peers.items()}
        last = list(times.values())[-1]
        for name, time in times.items():
            rows.append({"n": n, "what": name, "time [µs]": 1e6 * time, "ratio to the last": time / last})
    return rows, (
        f"Point features, {SEEN} seen (z of {M}); BLAS has one thread, by threadpoolctl. A whole frame: motion, "
        "detection, prediction, unknown association, update, initialisation. All is called from Python, a call of ours "
        f"for {FRAMES} frames, as an environment runs those of a decision; handing over the arrays is part of it."
    )


def _system(n: int) -> tuple[np.ndarray, ...]:
    """F (12, 12), Q (12, 12), P (n, n), H (16, n) and R (16, 16) with the zeros of ours."""
    rng = np.random.default_rng(n)
    F = np.eye(CAMERA_DIM)
    F[:6, 6:] = 0.05 * np.eye(6)
    H = np.zeros((M, n))
    H[:, :6] = 100.0 * rng.standard_normal((M, 6))
    for i in range(SEEN):
        at = CAMERA_DIM + 3 * i
        H[2 * i : 2 * i + 2, at : at + 3] = 100.0 * rng.standard_normal((2, 3))
    return F, 1e-6 * np.eye(CAMERA_DIM), 1e-4 * np.eye(n), H, 4.0 * np.eye(M)


def plain_numpy(n: int) -> Call:
    """Our predict + update as one would write it in NumPy: camera block, one Cholesky factor, no inverse."""
    F, Q, P, H, R = _system(n)
    x, nu = np.zeros(n), np.zeros(M)

    def step() -> None:
        P[:CAMERA_DIM, :] = F @ P[:CAMERA_DIM, :]
        P[:, :CAMERA_DIM] = P[:, :CAMERA_DIM] @ F.T
        P[:CAMERA_DIM, :CAMERA_DIM] += Q
        HP = H @ P
        K_T = cho_solve(cho_factor(HP @ H.T + R), HP)
        x[:] += nu @ K_T
        P[:] -= HP.T @ K_T
        P[:] = 0.5 * (P + P.T)

    return step


def filterpy_step(n: int) -> Call:
    """filterpy's EKF of that size."""
    from filterpy.kalman import ExtendedKalmanFilter

    F, Q, P, H, R = _system(n)
    ekf = ExtendedKalmanFilter(dim_x=n, dim_z=M)
    ekf.F, ekf.Q = np.eye(n), np.zeros((n, n))
    ekf.F[:CAMERA_DIM, :CAMERA_DIM], ekf.Q[:CAMERA_DIM, :CAMERA_DIM] = F, Q
    ekf.P, ekf.R, z = P, R, np.zeros((M, 1))

    def step() -> None:
        ekf.predict()
        ekf.update(z, lambda x: H, lambda x: H @ x)

    return step
