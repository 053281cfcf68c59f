"""Scores of candidate actions: the beliefs of runs, handed to `information`. B runs."""

from __future__ import annotations

import numpy as np

from activeslam_gym import information
from activeslam_gym.batching import row
from activeslam_gym.compilation import kernel, part
from activeslam_gym.envs.frame import Models, Simulation
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import STEPS, Run
from activeslam_gym.envs.workers import Workers
from activeslam_gym.information import Prospect, criterion_number, prospect_of
from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT, Gaze

_STAY = int(Gaze.STAY)
_LONGEST_HORIZON = 4


@part
def prospect(simulation: Simulation) -> Prospect:
    """What the run's belief lets a policy plan with."""
    K = simulation.world.points.shape[0] - simulation.expectation.points.shape[0]
    return prospect_of(
        simulation.belief,
        simulation.points,
        simulation.covariance,
        simulation.expectation,
        simulation.world.points[:K],  # the fiducials, which are known
    )


# Kernels over rows: each run's scores into its row of ``out``. ``frames`` in the period that a score is for,
# ``step_time`` [s] of a step.


@kernel(nogil=True)
def _motion_scores(
    models: Models, runs: Run, frames: int, step_time: float, criterion: int, out: np.ndarray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        run = row(runs, i)
        time, ahead = run.step.status[STEPS] * step_time, prospect(run.simulation)
        out[i] = information.motion_scores(models.camera, models.motion, ahead, frames, time, criterion, _STAY)


@kernel(nogil=True)
def _gaze_scores(
    models: Models, runs: Run, frames: int, step_time: float, criterion: int, out: np.ndarray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        run = row(runs, i)
        time, ahead = run.step.status[STEPS] * step_time, prospect(run.simulation)
        out[i] = information.gaze_scores(models.camera, models.motion, ahead, frames, time, criterion)


@kernel(nogil=True)
def _joint_scores(
    models: Models, runs: Run, frames: int, step_time: float, criterion: int, out: np.ndarray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        run = row(runs, i)
        time, ahead = run.step.status[STEPS] * step_time, prospect(run.simulation)
        out[i] = information.joint_scores(models.camera, models.motion, ahead, frames, time, criterion)


@kernel(nogil=True)
def _motion_score(
    models: Models,
    runs: Run,
    frames: int,
    step_time: float,
    criterion: int,
    index: int,
    out: np.ndarray,
    start: int,
    stop: int,
) -> None:
    for i in range(start, stop):
        run = row(runs, i)
        time, ahead = run.step.status[STEPS] * step_time, prospect(run.simulation)
        out[i] = information.motion_score(models.camera, models.motion, ahead, frames, time, criterion, _STAY, index)


@kernel(nogil=True)
def _lookahead_scores(
    models: Models, runs: Run, frames: int, step_time: float, horizon: int, out: np.ndarray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        run = row(runs, i)
        time, ahead = run.step.status[STEPS] * step_time, prospect(run.simulation)
        out[i] = information.lookahead_scores(models.camera, models.motion, ahead, frames, time, horizon)


# From names to kernels ----------------------------------------------------------------------------------------------


def _motion_period(setting: Setting) -> tuple[int, float]:
    """Frames of a motion period, and the time of a step [s]."""
    return setting.task.frames_per_step * setting.task.steps_per_motion, setting.gaze_period


def _out(runs: Run, *shape: int) -> np.ndarray:
    return np.empty((len(runs.step.status), *shape))


def motion_scores(setting: Setting, workers: Workers, runs: Run, criterion: str) -> np.ndarray:
    """(B, 7) see `Reads.motion_scores`."""
    out = _out(runs, MOTION_COUNT)
    number = criterion_number(criterion)
    workers.call(_motion_scores, setting.models, runs, *_motion_period(setting), number, out)
    return out


def gaze_scores(setting: Setting, workers: Workers, runs: Run, criterion: str) -> np.ndarray:
    """(B, 3) see `Reads.gaze_scores`."""
    out = _out(runs, GAZE_COUNT)
    number, frames = criterion_number(criterion), setting.task.frames_per_step
    workers.call(_gaze_scores, setting.models, runs, frames, setting.gaze_period, number, out)
    return out


def joint_scores(setting: Setting, workers: Workers, runs: Run, criterion: str) -> np.ndarray:
    """(B, 7, 3) see `Reads.joint_scores`."""
    out = _out(runs, MOTION_COUNT, GAZE_COUNT)
    number = criterion_number(criterion)
    workers.call(_joint_scores, setting.models, runs, *_motion_period(setting), number, out)
    return out


def motion_score(setting: Setting, workers: Workers, runs: Run, motion: int, criterion: str) -> np.ndarray:
    """(B,) one column of `motion_scores`, alone.

    Raises:
        ValueError: ``motion`` is no motion's index, or there is no such criterion.
    """
    if motion not in range(MOTION_COUNT):
        raise ValueError(f"motion must be in 0 … {MOTION_COUNT - 1}, got {motion!r}")
    out = _out(runs)
    number = criterion_number(criterion)
    workers.call(_motion_score, setting.models, runs, *_motion_period(setting), number, int(motion), out)
    return out


def lookahead_scores(setting: Setting, workers: Workers, runs: Run, horizon: int) -> np.ndarray:
    """(B, 7) see `Reads.lookahead_scores`.

    Raises:
        ValueError: ``horizon`` is not between 1 and 4.
    """
    if horizon not in range(1, _LONGEST_HORIZON + 1):
        raise ValueError(f"horizon must be a whole number in 1 … {_LONGEST_HORIZON}, got {horizon!r}")
    out = _out(runs, MOTION_COUNT)
    workers.call(_lookahead_scores, setting.models, runs, *_motion_period(setting), int(horizon), out)
    return out
