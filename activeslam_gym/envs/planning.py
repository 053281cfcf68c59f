"""Scores of candidate actions: the belief of a run, handed to `information`."""

from __future__ import annotations

import numpy as np
from numba import njit

from activeslam_gym import information
from activeslam_gym.envs.frame import Models, Simulation
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import STEPS, Run
from activeslam_gym.information import Prospect, criterion_number, prospect_of
from activeslam_gym.motion import MOTION_COUNT, Gaze

_STAY = int(Gaze.STAY)
_LONGEST_HORIZON = 4


@njit(cache=True)
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


@njit(cache=True)
def _motion_scores(models: Models, simulation: Simulation, frames: int, time: float, criterion: int) -> np.ndarray:
    ahead = prospect(simulation)
    return information.motion_scores(models.camera, models.motion, ahead, frames, time, criterion, _STAY)


@njit(cache=True)
def _gaze_scores(models: Models, simulation: Simulation, frames: int, time: float, criterion: int) -> np.ndarray:
    return information.gaze_scores(models.camera, models.motion, prospect(simulation), frames, time, criterion)


@njit(cache=True)
def _joint_scores(models: Models, simulation: Simulation, frames: int, time: float, criterion: int) -> np.ndarray:
    return information.joint_scores(models.camera, models.motion, prospect(simulation), frames, time, criterion)


@njit(cache=True)
def _motion_score(
    models: Models, simulation: Simulation, frames: int, time: float, criterion: int, index: int
) -> float:
    ahead = prospect(simulation)
    return information.motion_score(models.camera, models.motion, ahead, frames, time, criterion, _STAY, index)


@njit(cache=True)
def _lookahead_scores(models: Models, simulation: Simulation, frames: int, time: float, horizon: int) -> np.ndarray:
    return information.lookahead_scores(models.camera, models.motion, prospect(simulation), frames, time, horizon)


def _frames_and_time(setting: Setting, run: Run) -> tuple[int, float]:
    task = setting.task
    return task.frames_per_step * task.steps_per_motion, int(run.step.status[STEPS]) * setting.gaze_period


def motion_scores(setting: Setting, run: Run, criterion: str) -> np.ndarray:
    """(7,) see `ActiveSLAMEnv.motion_scores`."""
    return _motion_scores(setting.models, run.simulation, *_frames_and_time(setting, run), criterion_number(criterion))


def gaze_scores(setting: Setting, run: Run, criterion: str) -> np.ndarray:
    """(3,) see `ActiveSLAMEnv.gaze_scores`."""
    _, time = _frames_and_time(setting, run)
    frames = setting.task.frames_per_step
    return _gaze_scores(setting.models, run.simulation, frames, time, criterion_number(criterion))


def joint_scores(setting: Setting, run: Run, criterion: str) -> np.ndarray:
    """(7, 3) see `ActiveSLAMEnv.joint_scores`."""
    return _joint_scores(setting.models, run.simulation, *_frames_and_time(setting, run), criterion_number(criterion))


def motion_score(setting: Setting, run: Run, motion: int, criterion: str) -> float:
    """One of `motion_scores`, alone.

    Raises:
        ValueError: ``motion`` is no motion's index, or there is no such criterion.
    """
    if not 0 <= motion < MOTION_COUNT:
        raise ValueError(f"motion must be in 0 … {MOTION_COUNT - 1}, got {motion!r}")
    frames, time = _frames_and_time(setting, run)
    return _motion_score(setting.models, run.simulation, frames, time, criterion_number(criterion), int(motion))


def lookahead_scores(setting: Setting, run: Run, horizon: int) -> np.ndarray:
    """(7,) see `ActiveSLAMEnv.lookahead_scores`.

    Raises:
        ValueError: ``horizon`` is not between 1 and 4.
    """
    if horizon not in range(1, _LONGEST_HORIZON + 1):
        raise ValueError(f"horizon must be a whole number in 1 … {_LONGEST_HORIZON}, got {horizon!r}")
    return _lookahead_scores(setting.models, run.simulation, *_frames_and_time(setting, run), int(horizon))
