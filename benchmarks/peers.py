"""The same filtering by others: filterpy's EKF, and our update written plainly in NumPy."""

from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from activeslam_gym import Gaze, Motion
from activeslam_gym.kernels import row
from activeslam_gym.motion import CAMERA_DIM, COMMANDS

from .filtering import PointFilter, advance_frames
from .report import Bar, Section
from .setups import SEEN, copied, mapped_runs, restore
from .timing import Timing, repeated, restored

LANDMARKS = {93: 27, 129: 39}
"""n = 12 + 3 landmarks."""
FRAME = "a whole frame of ours, without entropy"
FRAMES = 5
"""Frames of a step: a decision every 0.25 s."""
M = 2 * SEEN


def run(quick: bool) -> Section:
    """Each at both sizes, as a ratio to filterpy's."""
    section = Section("Peers")
    repeats, at_least, count = (3, 0.02, 100) if quick else (9, 0.2, 1000)
    for n, landmarks in LANDMARKS.items():
        points = PointFilter(landmarks)
        times: dict[str, Timing] = {
            FRAME: whole_frame(landmarks, FRAMES, count),
            "the same, one frame a call": whole_frame(landmarks, 1, count),
            "predict + update of ours": repeated(partial(points.run, 1), repeats, at_least),
            "predict + update of ours in plain NumPy": repeated(plain_numpy(n), repeats, at_least),
        }
        peer = filterpy_step(n)
        if peer is not None:
            times["filterpy EKF predict + update"] = repeated(peer, repeats, at_least)
        ratios = {name: timing.seconds / list(times.values())[-1].seconds for name, timing in times.items()}
        for name, ratio in ratios.items():
            time = {"time [µs]": 1e6 * times[name].seconds}
            section.rows.append({"n": n, "what": name, **time, "ratio to the last": ratio})
        if peer is None:
            section.notes.append("filterpy is skipped: it is not installed (`pip install -e '.[bench]'`).")
        elif n == 93:
            section.bars.append(Bar("a whole frame of n = 93 / filterpy's predict + update", ratios[FRAME], 1 / 3, ""))
    section.notes.append(
        f"Point features, {SEEN} seen (z of {M}); BLAS has one thread, by threadpoolctl. A whole frame: motion, "
        "detection, prediction, unknown association, update, births. All is called from Python, a call of ours for "
        f"{FRAMES} frames, as an environment runs those of a decision; handing over the arrays is part of it."
    )
    return section


def whole_frame(landmarks: int, frames: int, count: int) -> Timing:
    """One of the ``frames`` of a step FORWARD, turning LEFT, in a map of points, each time from the same state."""
    runs = mapped_runs(landmarks)
    run, saved = row(runs, 0), copied(runs)
    step = partial(advance_frames, runs, COMMANDS[Motion.FORWARD, Gaze.LEFT], frames)
    timing = restored(step, lambda: restore(runs, saved), count)
    matched = int((run.candidate["match"][: run.episode.detections] > 0).sum())
    if matched != SEEN or run.estimate.state.count != landmarks:
        raise RuntimeError(f"{matched} of {SEEN} points were matched, {run.estimate.state.count} features")
    return Timing(timing.seconds / frames, timing.fastest / frames, timing.slowest / frames, timing.repeats)


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


def plain_numpy(n: int) -> Any:
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


def filterpy_step(n: int) -> Any:
    """filterpy's EKF of that size, or None without filterpy."""
    try:
        from filterpy.kalman import ExtendedKalmanFilter
    except ImportError:
        return None
    F, Q, P, H, R = _system(n)
    ekf = ExtendedKalmanFilter(dim_x=n, dim_z=M)
    ekf.F, ekf.Q = np.eye(n), np.zeros((n, n))
    ekf.F[:CAMERA_DIM, :CAMERA_DIM], ekf.Q[:CAMERA_DIM, :CAMERA_DIM] = F, Q
    ekf.P, ekf.R, z = P, R, np.zeros((M, 1))

    def step() -> None:
        ekf.predict()
        ekf.update(z, lambda x: H, lambda x: H @ x)

    return step
