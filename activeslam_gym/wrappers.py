"""Wrappers for clients that want the observation in parts."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorObservationWrapper
from gymnasium.vector.utils import batch_space

from activeslam_gym import observation_layout
from activeslam_gym.envs.observation import ObservationLayout

_KINDS = ("fiducial", "expected", "initialising", "mapped")
"""Features of a token of which one is 1, unless the token stands for nothing."""

Parts = dict[str, np.ndarray]


class TokenObservation(gymnasium.ObservationWrapper[Parts, Any, np.ndarray], gymnasium.utils.RecordConstructorArgs):
    """The observation as a `Dict`, for networks that treat landmarks as a set.

    ``global`` (32,) float32, or (39,) where there are boxes, ``tokens`` (T, 11) float32, and ``present`` (T,) int8: 1
    where a token stands for a landmark, which is a mask for attention and pooling. Names and scales of the features are
    those of `ActiveSLAMEnv`.

    Raises:
        ValueError: ``env`` is no ActiveSLAM environment.
    """

    def __init__(self, env: gymnasium.Env[np.ndarray, Any]) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        self._layout = observation_layout(env)
        super().__init__(env)
        self.observation_space = _token_space(self._layout)

    def observation(self, observation: np.ndarray) -> Parts:
        """(D,) in its parts."""
        return _in_parts(observation, self._layout)


class TokenVectorObservation(VectorObservationWrapper):
    """`TokenObservation` of a batch, whose parts have a leading axis; in mode NEXT_STEP or DISABLED.

    Raises:
        ValueError: ``env`` is no ActiveSLAM batch, or resets in the step that ends an episode.
    """

    def __init__(self, env: VectorEnv) -> None:
        self._layout = observation_layout(env)
        super().__init__(env)
        self.single_observation_space = _token_space(self._layout)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def observations(self, observations: np.ndarray) -> Parts:
        """(B, D) in their parts."""
        return _in_parts(observations, self._layout)


def _token_space(layout: ObservationLayout) -> spaces.Space[Any]:
    """The space of an observation in its parts."""
    shapes = {"global": (layout.tokens.start,), "tokens": layout.token_shape}
    parts: dict[str, Any] = {name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes.items()}
    return spaces.Dict({**parts, "present": spaces.MultiBinary(layout.token_shape[0])})


def _in_parts(observation: np.ndarray, layout: ObservationLayout) -> Parts:
    """Copies of the parts of flat observations (..., D), as `TokenObservation` names them."""
    tokens = observation[..., layout.tokens].reshape(*observation.shape[:-1], *layout.token_shape)
    kinds = tokens[..., [layout.token_slices[name].start for name in _KINDS]]
    return {
        "global": observation[..., : layout.tokens.start].copy(),
        "tokens": tokens.copy(),
        "present": (kinds.max(axis=-1) > 0).astype(np.int8),
    }
