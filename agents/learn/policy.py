"""Learned policies: their network, and its use as a policy."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.dqn.policies import DQNPolicy
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from activeslam_gym import Gaze, Motion, ObservationLayout, core_of, observation_layout
from activeslam_gym.config import whole_multiple
from activeslam_gym.motion import nearest_gaze, nearest_motion
from agents.learn.inputs import Inputs
from baselines.policy import Environment, action_space_of, actions_in

TOKEN_WIDTH = 64  # most units of the hidden layer of tokens in new networks


class SetEncoder(BaseFeaturesExtractor):
    """Global features, and the mean and the maximum of the encoded tokens, which do not depend on their order.

    The number of tokens does not enter the weights, so that they serve a room with more landmarks. An empty token (its
    kind is all zero) is left out, and costs no time.

    Args:
        observation_space: The flat observation's.
        layout: Slices of its parts.
        width: Units of the encoded global features, and of an encoded token.
        token_width: Units of the hidden layer of tokens, of which there are many.
    """

    def __init__(
        self, observation_space: spaces.Box, layout: ObservationLayout, width: int = 64, token_width: int = 64
    ) -> None:
        super().__init__(observation_space, features_dim=3 * width)
        self.layout = layout
        kinds = [layout.token_slices[name] for name in ("fiducial", "expected", "initialising", "mapped")]
        self.kinds = slice(kinds[0].start, kinds[-1].stop)
        self.globals = nn.Sequential(nn.Linear(layout.tokens.start, width), nn.Tanh())
        self.tokens = nn.Sequential(
            nn.Linear(layout.token_shape[1], token_width), nn.ReLU(), nn.Linear(token_width, width), nn.ReLU()
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """(B, D) -> (B, 3 width)."""
        tokens = observations[:, self.layout.tokens].unflatten(1, self.layout.token_shape)
        present = tokens[:, :, self.kinds].sum(dim=2) > 0.0
        general = self.globals(observations[:, : self.layout.tokens.start])
        return torch.cat([general, *self._pooled(tokens, present)], dim=1)

    def _pooled(self, tokens: torch.Tensor, present: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, T, W) and (B, T) -> mean and maximum (B, width) of the encoded tokens that are there."""
        encoded, row = self.tokens(tokens[present]), present.nonzero()[:, 0]
        none = encoded.new_zeros(len(tokens), encoded.shape[1])
        mean = none.index_add(0, row, encoded) / present.sum(dim=1, keepdim=True).clamp(min=1)
        return mean, none.scatter_reduce(0, row[:, None].expand_as(encoded), encoded, "amax")  # ReLU: 0 is the least


def policy_arguments(
    layout: ObservationLayout, width: int, weights: Mapping[str, np.ndarray] | None = None
) -> dict[str, Any]:
    """SB3's `policy_kwargs` of our policies: of new ones, or of a network for ``weights``."""
    token_width = min(width, TOKEN_WIDTH)
    for name, values in (weights or {}).items():
        if name.endswith("features_extractor.tokens.0.weight"):
            token_width = len(values)
    return {
        "features_extractor_class": SetEncoder,
        "features_extractor_kwargs": {"layout": layout, "width": width, "token_width": token_width},
        "net_arch": [width],
    }


class LearnedPolicy:
    """Trained weights behind the common `predict`, bound to the environment whose time it follows.

    It decides every ``decision_period`` seconds of the environment, as it was trained to, and holds its action in
    between: the network is asked only where a decision is due.

    Raises:
        ValueError: the weights do not fit the observation, or a wrapper of ``env`` changes it.
    """

    def __init__(self, env: Environment, weights: dict[str, np.ndarray], card: dict[str, Any]) -> None:
        self.card = card
        self._env = core_of(env)
        if env.observation_space != self._env.observation_space:
            raise ValueError("env: a wrapper changes its observations; allowed: those of the environment itself")
        decision_period = float(card["decision_period"])
        self._hold = whole_multiple("decision_period", decision_period, "gaze_period", self._env.gaze_period)
        firsts = [value for name, value in weights.items() if name.endswith("features_extractor.globals.0.weight")]
        if {one.shape[:-1] for one in firsts} != {(card["width"],)}:
            raise ValueError(f"width: {card['width']}, which is not that of the weights")
        layout = observation_layout(env)
        self._inputs, self._shape = Inputs(layout, firsts[0].shape[1]), (getattr(self._env, "num_envs", 1), layout.size)
        self._network = network_of(self._inputs.layout, weights, card)
        self._space = action_space_of(env)

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """(D,) -> (2,), (B, D) -> (B, 2), or the actions of the discrete and the continuous id; ``state`` holds the
        last decisions (B, 2), points (B, 4) of SAC on the continuous id.

        Raises:
            ValueError: a wrapper has changed the observation.
        """
        observations = np.atleast_2d(observation)
        if observations.shape != self._shape:
            raise ValueError(f"observation: of shape {np.shape(observation)}; allowed: that of the environment itself")
        step = np.round(np.atleast_1d(self._env.time) / self._env.gaze_period).astype(int)
        due = np.full(len(observations), True) if state is None else np.broadcast_to(step % self._hold == 0, len(state))
        if due.any():
            context = np.atleast_2d(self._env.context)[due] if self._inputs.contextual else None
            decided = self._decide(self._inputs(observations[due], context), deterministic)
            state = np.zeros((len(observations), decided.shape[1]), decided.dtype) if state is None else state.copy()
            state[due] = decided
        actions = state if state.shape[1] == 4 else actions_in(self._space, state)
        return (actions[0] if np.ndim(observation) == 1 else actions.copy()), state

    def _decide(self, inputs: np.ndarray, deterministic: bool) -> np.ndarray:
        """Motions and gazes (B, 2): the preferred ones, or drawn by the policy's own probabilities, which DQN
        has none of. Of SAC points (B, 4) where the environment takes them, or else the motion that is most of each and
        the nearest gaze."""
        with torch.inference_mode(), _one_thread():
            found = self._network._predict(torch.as_tensor(inputs), deterministic).numpy()
        if isinstance(self._network, DQNPolicy):
            return np.stack(np.divmod(found, len(Gaze)), axis=1)
        if isinstance(self._network, SACPolicy) and not isinstance(self._space, spaces.Box):
            return np.array([(nearest_motion(point), nearest_gaze(point[3])) for point in found], np.int64)
        return found


@contextmanager
def _one_thread() -> Iterator[None]:
    """PyTorch on one thread: a network this small is slower, by far, where several have to meet."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def network_of(layout: ObservationLayout, weights: dict[str, np.ndarray], card: dict[str, Any]) -> BasePolicy:
    """The network for a layout with these weights. Raises ValueError where they do not fit the observation."""
    kinds: dict[str, tuple[type[BasePolicy], spaces.Space]] = {
        "dqn": (DQNPolicy, spaces.Discrete(len(Motion) * len(Gaze))),
        "sac": (SACPolicy, spaces.Box(-1.0, 1.0, (4,), np.float32)),
    }
    kind, actions = kinds.get(card["algorithm"], (ActorCriticPolicy, spaces.MultiDiscrete([len(Motion), len(Gaze)])))
    space = spaces.Box(-1.0, 1.0, (layout.size,), np.float32)
    network = kind(space, actions, lambda _: 0.0, **policy_arguments(layout, int(card["width"]), weights))
    try:
        network.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
    except (RuntimeError, TypeError) as error:
        raise ValueError(
            f"the weights do not fit an observation of {layout.tokens.start} global features and tokens of "
            f"{layout.token_shape[1]}: {error}"
        ) from error
    network.set_training_mode(False)
    return network
