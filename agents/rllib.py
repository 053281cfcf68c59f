"""RLlib's policies: observations of one size for several scenarios, and the policy in a checkpoint."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym import observation_layout
from activeslam_gym.motion import MOTION_COUNT

MODULE = Path("learner_group", "learner", "rl_module", "default_policy")  # in the folder of a checkpoint


def padded_size(env: Any) -> int:
    """The size of an environment's `padded` observation, at least."""
    layout = observation_layout(env)
    return layout.size + (0 if "clearance" in layout.global_slices else MOTION_COUNT)


def padded(observation: NDArray[np.float32], env: Any, size: int) -> NDArray[np.float32]:
    """Observations (…, D) with a clearance of zeros where the scenario has none, and zero tokens up to ``size``.

    Raises:
        ValueError: they are larger.
    """
    if (least := padded_size(env)) > size:
        raise ValueError(f"size: {size}; allowed: {least} or more for this scenario's observation")
    layout = observation_layout(env)
    parts = observation[..., : layout.tokens.start], observation[..., layout.tokens]
    out = np.zeros((*observation.shape[:-1], size), np.float32)
    first = layout.tokens.start + least - layout.size
    out[..., : layout.tokens.start] = parts[0]
    out[..., first : first + parts[1].shape[-1]] = parts[1]
    return out


class Padded(gym.ObservationWrapper):
    """`padded` observations of a single environment."""

    def __init__(self, env: gym.Env, size: int) -> None:
        super().__init__(env)
        self._size = size
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (size,), np.float32)

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observation, `padded`."""
        return padded(observation, self.env, self._size)


class CheckpointPolicy:
    """The most likely action of the policy that RLlib wrote into a folder; its observations are `padded`."""

    def __init__(self, folder: Path, env: Any) -> None:
        from ray.rllib.core.rl_module.rl_module import RLModule

        self._env, self._module = env, RLModule.from_checkpoint(folder.resolve() / MODULE)
        self._size = self._module.observation_space.shape[0]

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Motion and gaze for an observation (D,) or a batch (B, D), and the ``state``, untouched."""
        import torch

        rows = torch.from_numpy(np.atleast_2d(padded(observation, self._env, self._size)))
        with torch.no_grad():
            inputs = self._module.forward_inference({"obs": rows})["action_dist_inputs"]
        chosen = self._module.get_inference_action_dist_cls().from_logits(inputs)
        actions = (chosen.to_deterministic() if deterministic else chosen).sample()
        actions = torch.stack(actions, -1) if isinstance(actions, (tuple, list)) else actions
        return actions.numpy().reshape(*np.shape(observation)[:-1], 2), state
