"""From a policy's name to the policy: a baseline, learned weights, a saved model, or the user's own."""

import importlib
import json
from collections.abc import Iterable, Sequence
from inspect import signature
from os import PathLike
from pathlib import Path
from traceback import extract_tb
from typing import Any
from zipfile import ZipFile

import numpy as np

import baselines
from activeslam_gym import core_of
from activeslam_gym.config import did_you_mean, positive_number, whole_multiple
from activeslam_gym.evaluation import Predictor, bound
from activeslam_gym.evaluation.code import digest
from agents.learn import weights
from agents.tools.files import reading
from baselines.policy import Environment

RLLIB = "rllib:"  # before the folder of a checkpoint that RLlib wrote
FILES = (".npz", ".zip")  # our weights, and a model as Stable-Baselines3 saves it


def load(name: str | PathLike[str], env: Environment, seed: int | Sequence[int] = 0) -> Predictor:
    """The policy of that name, bound to ``env``; see `agents.load`."""
    name = str(name)
    require_known(name)
    if name.startswith(RLLIB):
        from agents.rllib import CheckpointPolicy

        return CheckpointPolicy(Path(name.removeprefix(RLLIB)), env)
    if ":" in name:
        return bound(_imported(name), env)
    if (path := file_of(name)) and path.suffix == ".zip":
        return Held(_saved_model(path, env), env, period_of(name))
    if path:
        try:
            from agents.learn.policy import LearnedPolicy
        except ModuleNotFoundError as error:
            raise ImportError(f"policy {name!r} needs {error.name}: pip install --editable '.[agents]'") from error
        return LearnedPolicy(env, *weights.read(str(path)))
    return baselines.make(name, env, **({"seed": seed} if name == "random" else {}))


def require_known(name: str) -> None:
    """Raise ValueError, which lists the allowed names, for an unknown policy."""
    if ":" in name or name in baselines.names() or file_of(name):
        return
    if name.endswith(FILES):
        raise ValueError(f"policy: {name!r} is no file of weights")
    known = [*baselines.names(), *weights.shipped()]
    allowed = f"{', '.join(known)}, a file of weights (policy.npz, or model.zip of SB3), 'package.module:policy',"
    allowed += " rllib:FOLDER"
    raise ValueError(f"policy: {name!r} is unknown{did_you_mean(name, known)}; allowed: {allowed}")


def _saved_model(path: Path, env: Environment) -> Predictor:
    """The policy in a file that Stable-Baselines3 or sb3-contrib has saved."""
    from stable_baselines3.common.save_util import load_from_zip_file

    data, parameters, _ = load_from_zip_file(path, device="cpu")
    spaces = [data[name] for name in ("observation_space", "action_space")]
    here = [getattr(env, f"single_{name}", getattr(env, name)) for name in ("observation_space", "action_space")]
    for does, its, other in zip(("observes", "acts in"), spaces, here):
        if its != other:
            raise ValueError(f"it {does} {its}, the environment is of {other}; allowed: the same, or a factory")
    own = data["policy_kwargs"] | ({"use_sde": True} if data.get("use_sde") else {})
    takes = signature(data["policy_class"]).parameters.values()
    if any(one.name == "lr_schedule" or one.kind is one.VAR_KEYWORD for one in takes):  # no policy of ARS
        own |= {"lr_schedule": lambda _: 0.0}
    policy = data["policy_class"](*spaces, **own)
    policy.load_state_dict(parameters["policy"])
    policy.set_training_mode(False)
    return policy


class Held:
    """A ``policy`` that decides every ``period`` seconds of its environment, and holds its action in between; without
    a ``period``, in each step."""

    def __init__(self, policy: Predictor, env: Environment, period: float | None) -> None:
        self._policy, self._steps = policy, 1
        if period:
            self._env = core_of(env)
            self._steps = whole_multiple("decision_period", period, "gaze_period", self._env.gaze_period)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action, and as ``state`` the policy's own, beside the action where it is held."""
        if self._steps == 1:
            return self._policy.predict(observation, state, episode_start, deterministic)
        if state is None:
            action, new = self._policy.predict(observation, None, episode_start, deterministic)
            return action, (action, new)
        held, own = state
        due = np.round(np.atleast_1d(self._env.time) / self._env.gaze_period).astype(int) % self._steps == 0
        if not due.any():
            return held, state
        action, new = self._policy.predict(observation, own, episode_start, deterministic)
        if not due.all():  # of a batch, some
            action = np.where(due.reshape(-1, *(1,) * (np.ndim(action) - 1)), action, held)
            new = new and tuple(np.where(due[:, None], one, old) for one, old in zip(new, own))
        return action, (action, new)


def _imported(name: str) -> Any:
    """The user's own 'package.module:policy'."""
    module, _, attribute = name.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:
        allowed = "'package.module:policy'"
        raise ValueError(f"policy: {name!r} cannot be imported ({described(error)}); allowed: {allowed}") from error


def described(error: BaseException) -> str:
    """An error of a user's code and its place there, in a line."""
    lines = str(error).splitlines()
    frames = [frame for frame in extract_tb(error.__traceback__) if Path(frame.filename).is_file()]
    where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {lines[0] if lines else ''}{where}"


# What a name says before there is an environment --------------------------------------------------------------------


def holds_code(name: str) -> bool:
    """Whether a policy runs its user's code: a factory, which may read any file, or a saved model, a pickle."""
    return name.endswith(".zip") or ":" in name


def actions_of(name: str) -> str:
    """The actions of a policy: "Continuous" of weights of SAC; of a saved model its own, "Discrete" for an index."""
    path = file_of(name)
    if name.endswith(".zip"):
        with reading(Path(name)), ZipFile(path or name) as model:
            space = json.loads(model.read("data"))["action_space"][":type:"]
            return "Continuous" if ".Box" in space else "Discrete" if ".Discrete" in space else ""
    return "Continuous" if path and weights.read_card(path)["algorithm"] == "sac" else ""


def period_of(name: str) -> float | None:
    """Seconds between the decisions of a saved model, ``decision_period`` of the card beside it; None without one."""
    card = Path(name).with_suffix(".json")
    if not name.endswith(".zip") or not card.is_file():
        return None
    with reading(card):
        period = dict(json.loads(card.read_text(encoding="utf-8"))).get("decision_period")
        return None if period is None else positive_number("decision_period", period, "seconds")


def content(name: str) -> str:
    """Digest of a policy's file, weights or a saved model; "" of any other policy."""
    return digest(path) if (path := file_of(name)) else ""


def file_of(name: str) -> Path | None:
    """The file that a policy is in; None where it is in none."""
    path = Path(name)
    return path if path.suffix == ".zip" and path.is_file() else weights.path_of(name)


def files(names: Iterable[str]) -> dict[str, Path]:
    """The files of policies, by their paths in the working folder: another machine needs them.

    Raises ValueError for a path out of that folder, where another machine may have other weights.
    """
    named = [Path(name.removeprefix(RLLIB)) for name in names if name.startswith(RLLIB) or name.endswith(FILES)]
    if outside := [str(path) for path in named if path.is_absolute() or ".." in path.parts]:
        raise ValueError(f"policies: {outside[0]!r}; allowed on a cluster: a path below the working folder")
    return {str(one): one for path in named for one in (path, path.with_suffix(".json")) if one.exists()}
