"""Active SLAM as a Gymnasium environment: where should a camera go, and where should it look, to know the most?"""

from __future__ import annotations

import gymnasium

from activeslam_gym import compilation
from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMDiscreteEnv, ActiveSLAMEnv
from activeslam_gym.envs.active_slam_vector import ActiveSLAMDiscreteVectorEnv, ActiveSLAMVectorEnv
from activeslam_gym.envs.observation import ObservationLayout
from activeslam_gym.motion import Gaze, Motion

__version__ = "0.1.0"

compilation.announce_compilation()
compilation.hasten_compilation()
compilation.discard_stale_kernels()  # before any kernel is called, which is when Numba looks for its cache

__all__ = [
    "SCENARIOS",
    "ActiveSLAMDiscreteEnv",
    "ActiveSLAMDiscreteVectorEnv",
    "ActiveSLAMEnv",
    "ActiveSLAMVectorEnv",
    "Gaze",
    "Motion",
    "ObservationLayout",
    "Scenario",
    "observation_layout",
]

for _id, _name in (("ActiveSLAM-v0", "ActiveSLAM"), ("ActiveSLAMDiscrete-v0", "ActiveSLAMDiscrete")):
    gymnasium.register(
        _id,
        entry_point=f"activeslam_gym.envs.active_slam:{_name}Env",
        vector_entry_point=f"activeslam_gym.envs.active_slam_vector:{_name}VectorEnv",
    )


def observation_layout(env: gymnasium.Env | gymnasium.vector.VectorEnv) -> ObservationLayout:
    """Names, slices and the token shape of an environment's flat observation; the same for single and batched.

    Raises:
        ValueError: ``env`` is no ActiveSLAM environment.
    """
    setting = getattr(env.unwrapped, "setting", None)
    if setting is None:
        raise ValueError(f"env must be an ActiveSLAM environment, got {env!r}")
    return setting.layout
