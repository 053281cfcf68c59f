"""Learned policies: how they are built, kept and used.

Weights are kept as plain arrays (``.npz``, read without unpickling) beside a card (``.json``) that says how they came
to be; the network is built anew for the environment at hand.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy

from activeslam_gym import ObservationLayout, observation_layout
from activeslam_gym.config import whole_multiple
from agents import pretrained
from agents.encoder import SetEncoder
from agents.files import write_json, written_whole
from baselines.policy import Environment


def policy_arguments(layout: ObservationLayout, width: int) -> dict[str, Any]:
    """SB3's `policy_kwargs` of our policies."""
    return {
        "features_extractor_class": SetEncoder,
        "features_extractor_kwargs": {"layout": layout, "width": width},
        "net_arch": [width],
    }


def save(path: Path, policy: torch.nn.Module, card: dict[str, Any]) -> None:
    """Write a policy's weights to ``path`` (.npz) and its card beside it (.json), each whole or not at all."""
    with written_whole(path, "wb") as file:
        np.savez(file, **{name: value.cpu().numpy() for name, value in policy.state_dict().items()})
    write_json(path.with_suffix(".json"), card)


class LearnedPolicy:
    """Shipped weights behind the common `predict`, bound to the environment whose time it follows.

    It decides every ``decision_period`` seconds of the environment, as it was trained to, and holds its action in
    between.
    """

    def __init__(self, env: Environment, weights: dict[str, np.ndarray], card: dict[str, Any]) -> None:
        self.card = card
        self._env = cast(Any, env.unwrapped)
        self._hold = whole_multiple(
            "decision_period", float(card["decision_period"]), "gaze_period", self._env.gaze_period
        )
        self._policy = _network(observation_layout(env), weights, int(card["width"]))

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """(D,) -> (2,), (B, D) -> (B, 2), or indices on the discrete id; ``state`` holds the last decision."""
        single = np.ndim(observation) == 1
        with torch.no_grad():
            actions, _ = self._policy.predict(np.atleast_2d(observation), deterministic=deterministic)
        step = np.round(np.atleast_1d(self._env.time) / self._env.gaze_period).astype(int)
        if state is not None:
            actions = np.where((step % self._hold == 0)[:, None], actions, state)
        out = 3 * actions[:, 0] + actions[:, 1] if self._is_discrete() else actions
        return (out[0] if single else out), actions

    def _is_discrete(self) -> bool:
        space = getattr(self._env, "single_action_space", self._env.action_space)
        return isinstance(space, spaces.Discrete)


def _network(layout: ObservationLayout, weights: dict[str, np.ndarray], width: int) -> ActorCriticPolicy:
    """The network for a layout with these weights.

    Raises:
        ValueError: the weights do not fit the observation.
    """
    space = spaces.Box(-1.0, 1.0, (layout.size,), np.float32)
    policy = ActorCriticPolicy(space, spaces.MultiDiscrete([7, 3]), lambda _: 0.0, **policy_arguments(layout, width))
    try:
        policy.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
    except RuntimeError as error:
        raise ValueError(
            f"the weights do not fit an observation of {layout.tokens.start} global features and tokens of "
            f"{layout.token_shape[1]}: {error}"
        ) from error
    policy.set_training_mode(False)
    return policy


def load(name: str, env: Environment, folder: Path = pretrained.FOLDER) -> LearnedPolicy:
    """The learned policy of that name (a file's stem in ``folder``), bound to ``env``.

    Raises:
        ValueError: there is no such policy, or its weights do not fit the environment's observation.
    """
    known = pretrained.names(folder)
    if name not in known:
        raise ValueError(
            f"name must be one of {', '.join(known) or 'none, since no weights are shipped'}, got {name!r}"
        )
    with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
        weights = {key: file[key] for key in file.files}
    return LearnedPolicy(env, weights, json.loads((folder / f"{name}.json").read_text(encoding="utf-8")))
