"""From a policy's name to the policy: a baseline, shipped weights, a file of weights, or the user's own factory."""

import hashlib
import importlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from traceback import extract_tb
from typing import Any
from zipfile import ZipFile

import baselines
from activeslam_gym.config import did_you_mean
from activeslam_gym.evaluation import Predictor
from activeslam_gym.evaluation.code import digest, own_files
from agents import pretrained
from agents.tools.files import reading
from baselines.policy import Environment

Factory = Callable[[Environment, int | Sequence[int]], Predictor]
"""(environment, seed) -> a policy bound to that environment; a random one draws from the seed, of a batch one for each.
"""
RLLIB = "rllib:"  # before the folder of a checkpoint that RLlib wrote
FILES = (".npz", ".zip")  # our weights, and a model as Stable-Baselines3 saves it


def resolve(name: str, env: Environment, seed: int | Sequence[int] = 0) -> Predictor:
    """Return the policy `name` bound to `env`. Raises ValueError as `factory` does."""
    return factory(name)(env, seed)


def factory(name: str) -> Factory:
    """Return the factory of the policy `name`: a baseline, shipped weights, a file, 'package.module:factory', or
    'rllib:FOLDER'.

    Raises ValueError, which lists the allowed names, for an unknown one.
    """
    if ":" in name and not name.startswith(RLLIB):
        make = _imported(name)
        return lambda env, seed: Own(name, make, env)
    if name.startswith(RLLIB):
        from agents.rllib import CheckpointPolicy

        return lambda env, seed: Own(name, partial(CheckpointPolicy, _at(name)), env)
    if name in baselines.names():
        return lambda env, seed: baselines.make(name, env, **({"seed": seed} if name == "random" else {}))
    if (path := file_of(name)) and path.suffix == ".npz":
        return lambda env, seed: learned(path.stem, env, path.parent)
    if path:
        return lambda env, seed: Own(name, lambda env: _saved_model(path, env), env)
    if name.endswith(FILES):
        raise ValueError(f"policy: {name!r} is no file of weights")
    known = [*baselines.names(), *pretrained.names()]
    allowed = f"{', '.join(known)}, a file of weights (policy.npz, or model.zip of SB3), 'package.module:factory',"
    allowed += " rllib:FOLDER"
    raise ValueError(f"policy: {name!r} is unknown{did_you_mean(name, known)}; allowed: {allowed}")


def file_of(name: str) -> Path | None:
    """The file that a policy is in; None where it is in none."""
    path = _at(name)
    return path if path.suffix == ".zip" and path.is_file() else pretrained.path_of(str(path))


def files(names: Iterable[str]) -> dict[str, Path]:
    """What policies need on another machine beside the clone: path in a working folder there → path here."""
    found, modules = {}, {name.partition(":")[0] for name in names if ":" in name and not name.startswith(RLLIB)}
    for name in names:
        if name.startswith(RLLIB):
            found[str(_there(name))] = _at(name)
        elif name.endswith(FILES) and (path := file_of(name)):
            card = path.with_suffix(".json")
            found |= {str(_there(name).with_suffix(one.suffix)): one for one in (path, card) if one.exists()}
    return {**own_files(modules), **found}


def _at(name: str) -> Path:
    """Where a policy's file or checkpoint is."""
    return _there(name) if _there(name).exists() else Path(name.removeprefix(RLLIB))


def _there(name: str) -> Path:
    """Where a policy's file is found on a machine that it was sent to."""
    return Path(".sent", hashlib.sha256(name.encode(errors="surrogatepass")).hexdigest()[:16]).with_suffix(
        Path(name).suffix
    )


def holds_code(name: str) -> bool:
    """Whether a policy runs its user's code: a factory, which may read any file, or a saved model, a pickle."""
    return name.endswith(".zip") or ":" in name


def offered(name: str) -> Callable[[Environment], Predictor]:
    """The same with one seed, as `activeslam_gym.policies` among the entry points: see `live --adviser`."""
    make = factory(name)
    return lambda env: make(env, 0)


def learned(name: str, env: Environment, folder: Path) -> Predictor:
    """The policy of the weights ``name``.npz in a folder. ValueError where there are none, or they do not fit."""
    from agents.learn.weights import LearnedPolicy, read

    return LearnedPolicy(env, *read(name, folder))


def actions_of(name: str) -> str:
    """The actions of a policy: "Continuous" of weights of SAC; of a saved model its own, "Discrete" for an index."""
    if name.endswith(".zip"):
        path = file_of(name) or Path(name)
        with reading(path), ZipFile(path) as model:
            space = json.loads(model.read("data"))["action_space"][":type:"]
            return "Continuous" if ".Box" in space else "Discrete" if ".Discrete" in space else ""
    if (weights := file_of(name)) is None:
        return ""
    from agents.learn.card import read_card

    return "Continuous" if read_card(weights)["algorithm"] == "sac" else ""


def content(name: str) -> str:
    """Digest of a policy's own files: weights, a checkpoint, or a module and its imports; "" of a baseline."""
    if (path := file_of(name)) and path.suffix == ".npz":
        return digest(path)
    found = files([name]).values()
    whole = sorted(file for path in found for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())
    return digest(*(file for file in whole if file.suffix != ".pyc")) if whole else ""


class Own:
    """A user's own policy, whose errors become a ValueError of one line.

    Raises ValueError where its factory fails, or makes an object without `predict`.
    """

    def __init__(self, name: str, make: Callable[[Environment], Any], env: Environment) -> None:
        self._name = name
        with _failures(f"policy: {name!r}, called as factory(env): "):
            self._policy = make(env)
        if not callable(getattr(self._policy, "predict", None)):
            allowed = "an object with predict(observation, …)"
            raise ValueError(f"policy: {name!r} made {self._policy!r}; allowed: {allowed}")

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """The policy's own action and state."""
        asked = {"state": state, "episode_start": episode_start, "deterministic": deterministic}
        with _failures(f"policy: {self._name!r}, asked for (action, state): "):
            action, state = self._policy.predict(observation, **asked)
        return action, state


def _saved_model(path: Path, env: Environment) -> Predictor:
    """The policy in a file that Stable-Baselines3 or sb3-contrib has saved."""
    from stable_baselines3.common.save_util import load_from_zip_file

    data, weights, _ = load_from_zip_file(path, device="cpu")
    observed, here = data["observation_space"], getattr(env, "single_observation_space", env.observation_space)
    if observed != here:
        raise ValueError(f"it observes {observed}, the environment is of {here}; allowed: the same, or a factory")
    policy = data["policy_class"](observed, data["action_space"], lambda _: 0.0, **data["policy_kwargs"])
    policy.load_state_dict(weights["policy"])
    policy.set_training_mode(False)
    return policy


def _imported(name: str) -> Callable[[Environment], Any]:
    """The user's own 'package.module:factory'."""
    module, _, attribute = name.partition(":")
    with _failures(f"policy: {name!r} cannot be imported (", "); allowed: 'package.module:factory'"):
        return getattr(importlib.import_module(module), attribute)


@contextmanager
def _failures(before: str, after: str = "") -> Iterator[None]:
    """Turn whatever a user's code raises into a ValueError, but for Ctrl-C."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise ValueError(f"{before}{_told(error)}{after}") from error


def _told(error: BaseException) -> str:
    """An error and its place in the user's code, in a line."""
    lines = str(error).splitlines()
    frames = [frame for frame in extract_tb(error.__traceback__) if Path(frame.filename).is_file()]
    ours = frames[-1].filename in (__file__, importlib.__file__)
    where = "" if ours else f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return f"{type(error).__name__}: {lines[0] if lines else ''}{where}"
