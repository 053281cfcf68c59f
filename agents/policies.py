"""From a policy's name to the policy: a baseline, shipped weights, a file of weights, or the user's own factory."""

import importlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from traceback import extract_tb
from typing import Any

import baselines
from activeslam_gym.config import did_you_mean
from activeslam_gym.evaluation import Predictor
from activeslam_gym.evaluation.code import digest, module_sources, package_versions
from agents import pretrained
from baselines.policy import Environment

Factory = Callable[[Environment, int | Sequence[int]], Predictor]
"""(environment, seed) -> a policy bound to that environment; a random one draws from the seed, of a batch one for each.
"""
LEARNED = Path(__file__).with_name("learn")
LEARNING_LIBRARIES = ("stable-baselines3", "torch")


def resolve(name: str, env: Environment, seed: int | Sequence[int] = 0) -> Predictor:
    """Return the policy `name` bound to `env`. Raises ValueError as `factory` does."""
    return factory(name)(env, seed)


def factory(name: str) -> Factory:
    """Return the factory of the policy `name`: a baseline, shipped weights, 'policy.npz' or 'package.module:factory'.

    Raises ValueError, which lists the allowed names, for an unknown one.
    """
    if ":" in name:
        make = _imported(name)
        return lambda env, seed: Own(name, make, env)
    if name in baselines.names():
        return lambda env, seed: baselines.make(name, env, **({"seed": seed} if name == "random" else {}))
    if path := pretrained.path_of(name):
        return lambda env, seed: learned(path.stem, env, path.parent)
    if name.endswith(".npz"):
        raise ValueError(f"policy: {name!r} is no file of weights")
    known = [*baselines.names(), *pretrained.names()]
    allowed = f"{', '.join(known)}, a file of weights (policy.npz), 'package.module:factory'"
    raise ValueError(f"policy: {name!r} is unknown{did_you_mean(name, known)}; allowed: {allowed}")


def offered(name: str) -> Callable[[Environment], Predictor]:
    """The same with one seed, as `activeslam_gym.policies` among the entry points: see `live --adviser`."""
    make = factory(name)
    return lambda env: make(env, 0)


def learned(name: str, env: Environment, folder: Path) -> Predictor:
    """The policy of the weights ``name``.npz in a folder. ValueError where there are none, or they do not fit."""
    from agents.learn.weights import LearnedPolicy, read

    return LearnedPolicy(env, *read(name, folder))


def acts_in_points(name: str) -> bool:
    """Whether a policy has continuous actions: weights of SAC."""
    if (path := pretrained.path_of(name)) is None:
        return False
    from agents.learn.card import read_card

    return bool(read_card(path)["algorithm"] == "sac")


def content(name: str) -> str:
    """Digest of a policy's files, apart from the baselines: weights and the network, or a module and its imports, and
    all weights shipped, which it may load."""
    if ":" in name:
        made_of = f"{module_sources(name.partition(':')[0])} {digest(*sorted(pretrained.FOLDER.glob('*.npz')))}"
    elif path := pretrained.path_of(name):
        network = [LEARNED / f"{module}.py" for module in ("card", "encoder", "inputs", "weights")]
        made_of = digest(*filter(Path.exists, (path, path.with_suffix(".json"))), *network)
    else:
        return ""
    return f"{made_of} {json.dumps(package_versions(LEARNING_LIBRARIES))}"


class Own:
    """A user's own policy, whose errors become a ValueError of one line.

    Raises ValueError where its factory fails, or makes an object without `predict`.
    """

    def __init__(self, name: str, make: Callable[[Environment], Any], env: Environment) -> None:
        self._name = name
        try:
            self._policy = make(env)
        except Exception as error:
            raise ValueError(f"policy: {name!r}, called as factory(env): {_told(error)}") from error
        if not callable(getattr(self._policy, "predict", None)):
            allowed = "an object with predict(observation, …)"
            raise ValueError(f"policy: {name!r} made {self._policy!r}; allowed: {allowed}")

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """The policy's own action and state."""
        asked = {"state": state, "episode_start": episode_start, "deterministic": deterministic}
        try:
            action, state = self._policy.predict(observation, **asked)
        except Exception as error:
            raise ValueError(f"policy: {self._name!r}, asked for (action, state): {_told(error)}") from error
        return action, state


def _imported(name: str) -> Callable[[Environment], Any]:
    """The user's own 'package.module:factory'."""
    module, _, attribute = name.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:
        told = f"policy: {name!r} cannot be imported ({_told(error)})"
        raise ValueError(f"{told}; allowed: 'package.module:factory'") from error


def _told(error: BaseException) -> str:
    """An error and its place in the user's code, in a line."""
    lines = str(error).splitlines()
    frames = [frame for frame in extract_tb(error.__traceback__) if Path(frame.filename).is_file()]
    ours = frames[-1].filename in (__file__, importlib.__file__)
    where = "" if ours else f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return f"{type(error).__name__}: {lines[0] if lines else ''}{where}"
