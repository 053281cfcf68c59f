"""From an environment's plain arguments to the constants of its kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from activeslam_gym.config import Scenario, scenario_from, whole_multiple
from activeslam_gym.envs.frame import Models, models_of
from activeslam_gym.envs.observation import ObservationLayout, layout_of
from activeslam_gym.envs.reward import reward_number
from activeslam_gym.envs.step import Task


@dataclass(frozen=True)
class Setting:
    """Resolved arguments; times in seconds."""

    scenario: Scenario
    gaze_period: float
    motion_period: float
    duration: float
    reward: str
    models: Models
    task: Task
    layout: ObservationLayout


def resolve(
    scenario: str | Mapping[str, Any] | Scenario,
    gaze_period: float | None,
    motion_period: float,
    duration: float,
    reward: str,
    lost_position_error: float,
) -> Setting:
    """Check the arguments of an environment and work out its constants.

    Raises:
        ValueError: an argument is unknown, out of range, or no whole number of the period that it must be made of; the
            message names it, its value and what is allowed.
    """
    resolved = scenario_from(scenario)
    frame = resolved.frame_time
    frames_per_step = 1 if gaze_period is None else whole_multiple("gaze_period", gaze_period, "the frame", frame)
    step_time = frames_per_step * frame
    steps_per_motion = whole_multiple("motion_period", motion_period, "gaze_period", step_time)
    steps = whole_multiple("duration", duration, "gaze_period", step_time)
    lost = lost_position_error
    if isinstance(lost, bool) or not isinstance(lost, (int, float)) or not lost > 0 or math.isnan(lost):
        raise ValueError(f"lost_position_error must be a positive number of metres, got {lost!r}")
    task = Task(
        frames_per_step=frames_per_step,
        steps_per_motion=steps_per_motion,
        steps=steps,
        reward=reward_number(reward),
        lost_position_error=float(lost),
        mapped_depth_ratio=float(resolved.mapped_depth_ratio),
        labelled_first_match=resolved.labelled_first_match,
    )
    return Setting(
        scenario=resolved,
        gaze_period=step_time,
        motion_period=steps_per_motion * step_time,
        duration=steps * step_time,
        reward=reward,
        models=models_of(resolved, steps_per_motion * step_time),
        task=task,
        layout=layout_of(resolved),
    )


def observation_space(setting: Setting) -> spaces.Box:
    """Of one environment: float32 (D,) in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (setting.layout.size,), np.float32)


def render_rate(setting: Setting) -> int:
    """Frames a second at which a video of one picture a step shows true time."""
    return max(1, round(1.0 / setting.gaze_period))
