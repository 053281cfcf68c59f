"""Active SLAM as a Gymnasium environment: where should a camera go, and where should it look, to know the most?"""

from typing import Any

import gymnasium

from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMContinuousEnv, ActiveSLAMDiscreteEnv, ActiveSLAMEnv
from activeslam_gym.envs.active_slam_vector import (
    ActiveSLAMContinuousVectorEnv,
    ActiveSLAMDiscreteVectorEnv,
    ActiveSLAMVectorEnv,
)
from activeslam_gym.envs.checks import check_estimator, check_scene, check_sensor
from activeslam_gym.envs.compiling import warm_up
from activeslam_gym.envs.observation import CONTEXT_FEATURES, ObservationLayout
from activeslam_gym.motion import Gaze, Motion

__version__ = "0.1.0"
BEHAVIOUR = 24
"""Raised with every change of what the same seed and actions of ``ActiveSLAM-v0`` lead to, or those of
``ActiveSLAMPixels-v0``; the cards of shipped weights tell theirs."""

__all__ = [
    "BEHAVIOUR",
    "CONTEXT_FEATURES",
    "SCENARIOS",
    "ActiveSLAMContinuousEnv",
    "ActiveSLAMContinuousVectorEnv",
    "ActiveSLAMDiscreteEnv",
    "ActiveSLAMDiscreteVectorEnv",
    "ActiveSLAMEnv",
    "ActiveSLAMVectorEnv",
    "Gaze",
    "Motion",
    "ObservationLayout",
    "Scenario",
    "check_estimator",
    "check_scene",
    "check_sensor",
    "core_of",
    "observation_layout",
    "warm_up",
]

for _name in ("ActiveSLAM", "ActiveSLAMDiscrete", "ActiveSLAMContinuous", "ActiveSLAMPixels"):
    gymnasium.register(
        f"{_name}-v0",
        entry_point=f"activeslam_gym.envs.active_slam:{_name}Env",
        vector_entry_point=f"activeslam_gym.envs.active_slam_vector:{_name}VectorEnv",
    )


def core_of(env: gymnasium.Env | gymnasium.vector.VectorEnv) -> Any:
    """The ActiveSLAM environment, single or batched, inside all wrappers of ``env``.

    Raises:
        ValueError: there is none.
    """
    core = getattr(env, "unwrapped", None)
    if not hasattr(core, "motion_phase"):  # which every ActiveSLAM environment has, and what stands in for one
        raise ValueError(f"env must be an ActiveSLAM environment, got {env!r}")
    return core


def observation_layout(env: gymnasium.Env | gymnasium.vector.VectorEnv) -> ObservationLayout:
    """Names, slices and the token shape of an environment's flat observation; the same for single and batched.

    Raises:
        ValueError: ``env`` is no ActiveSLAM environment.
    """
    return core_of(env).setting.layout
