"""Learned policies: their network, their file and their use.

Weights are kept as plain arrays (``.npz``, read without unpickling) with their card, in the same file and as ``.json``
beside it; the network is rebuilt for the environment at hand.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.dqn.policies import DQNPolicy
from stable_baselines3.sac.policies import SACPolicy

from activeslam_gym import Gaze, Motion, ObservationLayout, core_of, observation_layout
from activeslam_gym.config import whole_multiple
from activeslam_gym.files import written_whole
from activeslam_gym.motion import COMMANDS, nearest_gaze, nearest_motion
from agents import pretrained
from agents.learn.card import CARD, read_card
from agents.learn.encoder import SetEncoder
from agents.learn.inputs import Inputs
from agents.tools.files import json_text, reading, write_json
from baselines.policy import Environment

TOKEN_WIDTH = 64  # most units of the hidden layer of tokens in new networks


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


def save(path: Path, policy: torch.nn.Module, card: dict[str, Any]) -> None:
    """Write a policy's weights and its card to ``path`` (.npz), and the card beside it (.json).

    Wherever the process is killed, the weights in the folder have their own card: the new file holds both, and takes
    its place when the card of the old weights is gone. Raises ValueError for weights that are not finite.
    """
    weights: dict[str, Any] = {name: value.cpu().numpy() for name, value in policy.state_dict().items()}
    require_finite(weights)
    beside = path.with_suffix(".json")
    with written_whole(path) as unfinished:
        np.savez(unfinished, **(weights | {CARD: json_text(card)}))
        beside.unlink(missing_ok=True)
    write_json(beside, card)


def read(name: str, folder: Path = pretrained.FOLDER) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Weights and card of ``NAME.npz`` in a folder.

    Raises:
        ValueError: there are none of that name, or they are damaged.
    """
    known = pretrained.names(folder)
    if name not in known:
        raise ValueError(
            f"name must be one of {', '.join(known) or 'none, since no weights are shipped'}, got {name!r}"
        )
    path = folder / f"{name}.npz"
    with reading(path), np.load(path, allow_pickle=False) as file:
        weights = {key: file[key] for key in file.files if key != CARD}
        require_finite(weights)
    return weights, read_card(path)


def require_finite(weights: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError where weights are not all finite numbers."""
    for name, values in weights.items():
        if values.dtype.kind != "f" or not np.isfinite(values).all():
            raise ValueError(f"weights: {name} has values that are no finite numbers; the training has diverged")


class LearnedPolicy:
    """Trained weights behind the common `predict`, bound to the environment whose time it follows.

    It decides every ``decision_period`` seconds of the environment, as it was trained to, and holds its action in
    between: the network is asked only where a decision is due.
    """

    def __init__(self, env: Environment, weights: dict[str, np.ndarray], card: dict[str, Any]) -> None:
        self.card = card
        self._env = core_of(env)
        decision_period = float(card["decision_period"])
        self._hold = whole_multiple("decision_period", decision_period, "gaze_period", self._env.gaze_period)
        firsts = [value for name, value in weights.items() if name.endswith("features_extractor.globals.0.weight")]
        if {one.shape[:-1] for one in firsts} != {(card["width"],)}:
            raise ValueError(f"width: {card['width']}, which is not that of the weights")
        self._inputs = Inputs(observation_layout(env), firsts[0].shape[1])
        self._actor = _actor(self._inputs.layout, weights, card)
        self._space = getattr(self._env, "single_action_space", self._env.action_space)

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """(D,) -> (2,), (B, D) -> (B, 2), or the actions of the discrete and the continuous id; ``state`` holds the
        last decisions (B, 2), points (B, 4) of SAC on the continuous id."""
        observations = np.atleast_2d(observation)
        step = np.round(np.atleast_1d(self._env.time) / self._env.gaze_period).astype(int)
        due = np.full(len(observations), True) if state is None else np.broadcast_to(step % self._hold == 0, len(state))
        if due.any():
            decided = self._decide(self._read(observations, due), deterministic)
            state = np.zeros((len(observations), decided.shape[1]), decided.dtype) if state is None else state.copy()
            state[due] = decided
        actions = self._encoded(state)
        return (actions[0] if np.ndim(observation) == 1 else actions.copy()), state

    def probabilities(self, observations: np.ndarray) -> list[np.ndarray]:
        """(B, D) of all environments -> (B, 7) of each motion and (B, 3) of each gaze, of an actor-critic."""
        with torch.inference_mode(), _one_thread():
            logits = self._actor(torch.as_tensor(self._read(observations, np.full(len(observations), True))))
            return [part.softmax(dim=1).numpy() for part in logits]

    def _read(self, observations: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """The inputs of the network, of the ``chosen`` environments."""
        context = np.atleast_2d(self._env.context) if self._inputs.contextual else observations
        return self._inputs(observations[chosen], context[chosen])

    def _decide(self, inputs: np.ndarray, deterministic: bool) -> np.ndarray:
        """Motions and gazes (B, 2): the preferred ones, or drawn by the policy's own probabilities. Of SAC its mean,
        where the environment takes points (B, 4), or else the nearest pair."""
        with torch.inference_mode(), _one_thread():
            logits = self._actor(torch.as_tensor(inputs))
            if self.card["algorithm"] == "sac":
                points = logits[0].numpy()
                if isinstance(self._space, spaces.Box):
                    return points
                return np.array([(nearest_motion(point), nearest_gaze(point[3])) for point in points], np.int64)
            if deterministic or len(logits) == 1:  # values are no probabilities
                parts = [part.argmax(dim=1).numpy() for part in logits]
            else:
                parts = [torch.multinomial(part.softmax(dim=1), 1)[:, 0].numpy() for part in logits]
        return np.stack(parts if len(parts) == 2 else np.divmod(parts[0], len(Gaze)), axis=1)

    def _encoded(self, decided: np.ndarray) -> np.ndarray:
        """Decisions, pairs or points, as actions of the environment."""
        if isinstance(self._space, spaces.Discrete):
            return len(Gaze) * decided[:, 0] + decided[:, 1]
        if isinstance(self._space, spaces.Box) and decided.shape[1] == 2:
            return COMMANDS[decided[:, 0], decided[:, 1]].astype(np.float32)
        return decided


@contextmanager
def _one_thread() -> Iterator[None]:
    """PyTorch on one thread: a network this small is slower, by far, where several have to meet."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class Actor(torch.nn.Module):
    """Of a network the part that decides, without the critic and the distributions of SB3's `predict`: a third of its
    time."""

    def __init__(self, network: BasePolicy) -> None:
        super().__init__()
        self.network = network

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """(B, D) -> preferences of motions (B, 7) and gazes (B, 3); of DQN the values of the joint actions (B, 21), of
        SAC the action (B, 4)."""
        if isinstance(self.network, DQNPolicy):
            return (self.network.q_net(observations),)
        if isinstance(self.network, SACPolicy):
            return (self.network.actor(observations, deterministic=True),)
        latent = self.network.mlp_extractor.forward_actor(self.network.extract_features(observations))
        return self.network.action_net(latent).split((len(Motion), len(Gaze)), dim=1)


def _actor(layout: ObservationLayout, weights: dict[str, np.ndarray], card: dict[str, Any]) -> Actor:
    """The network for a layout with these weights.

    Raises:
        ValueError: the weights do not fit the observation.
    """
    space = spaces.Box(-1.0, 1.0, (layout.size,), np.float32)
    arguments = policy_arguments(layout, int(card["width"]), weights)
    network: BasePolicy
    if card["algorithm"] == "dqn":
        network = DQNPolicy(space, spaces.Discrete(len(Motion) * len(Gaze)), lambda _: 0.0, **arguments)
    elif card["algorithm"] == "sac":
        network = SACPolicy(space, spaces.Box(-1.0, 1.0, (4,), np.float32), lambda _: 0.0, **arguments)
    else:
        network = ActorCriticPolicy(space, spaces.MultiDiscrete([len(Motion), len(Gaze)]), lambda _: 0.0, **arguments)
    try:
        network.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
    except (RuntimeError, TypeError) as error:
        raise ValueError(
            f"the weights do not fit an observation of {layout.tokens.start} global features and tokens of "
            f"{layout.token_shape[1]}: {error}"
        ) from error
    network.set_training_mode(False)
    return Actor(network)
