"""RLlib's policies: observations of one size for several scenarios, and the policy in a checkpoint."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym import observation_layout
from agents.learn.inputs import Inputs, common_size

MODULE = Path("learner_group", "learner", "rl_module", "default_policy")  # in the folder of a checkpoint


class Padded(gym.ObservationWrapper):
    """A single environment whose observations have range finders, and so many ``tokens``, in every scenario."""

    def __init__(self, env: gym.Env, tokens: int) -> None:
        super().__init__(env)
        layout = observation_layout(env)
        self._inputs = Inputs(layout, common_size(layout, context=False), tokens)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (self._inputs.layout.size,), np.float32)

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observation, padded."""
        return self._inputs(observation[None])[0]


class CheckpointPolicy:
    """The most likely action of the policy that RLlib wrote into a folder, trained in `Padded` environments."""

    def __init__(self, folder: Path, env: Any) -> None:
        from ray.rllib.core.rl_module.rl_module import RLModule

        self._module = RLModule.from_checkpoint(folder.resolve() / MODULE)
        layout = observation_layout(env)
        known = common_size(layout, context=False)
        tokens = (self._module.observation_space.shape[0] - known) // layout.token_shape[1]
        self._inputs = Inputs(layout, known, tokens)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Motion and gaze for an observation (D,) or a batch (B, D), and the ``state``, untouched."""
        import torch

        rows = torch.from_numpy(self._inputs(np.atleast_2d(observation)))
        with torch.no_grad():
            inputs = self._module.forward_inference({"obs": rows})["action_dist_inputs"]
        chosen = self._module.get_inference_action_dist_cls().from_logits(inputs)
        actions = (chosen.to_deterministic() if deterministic else chosen).sample()
        actions = torch.stack(actions, -1) if isinstance(actions, (tuple, list)) else actions
        return actions.numpy().reshape(*np.shape(observation)[:-1], 2), state
