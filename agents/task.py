"""Episodes to play, by names: of the policy, of the environment's arguments, of measures beside the record."""

import hashlib
import json
import re
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from inspect import getfile
from pathlib import Path
from typing import Any

import gymnasium as gym

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym.config import IMAGE_SCENARIOS, fields_of
from activeslam_gym.evaluation import Episode, Observer, Store, play
from activeslam_gym.evaluation.code import digest, foreign_modules, own_files, package_sources
from activeslam_gym.evaluation.store import Arrays, run_all
from agents import policies
from agents.tools.arguments import made_scenario
from agents.tools.sections import in_a_line

SAMPLE_PERIOD = 1.0  # between the samples of an episode that is not kept whole [s]


@dataclass(frozen=True)
class Task:
    """One episode to play; it is a `Job` of the store."""

    policy: str
    seed: int
    settings: str = "{}"  # arguments of `make_environment`, as JSON: what episodes must share to be compared
    whole: bool = False  # keep every sample (of the episode that is drawn) instead of one a second
    measures: tuple[type[Any], ...] = ()  # classes of observers, which may have results beside the record

    def __str__(self) -> str:
        return f"{self.policy}, episode {self.seed}"

    @property
    def label(self) -> str:
        return f"{file_name(self.policy)}-{self.seed}"

    @property
    def group(self) -> Any:
        own = policies.holds_code(self.policy) and self.seed  # a user's policy may act in one environment alone
        return self.policy, self.settings, self.whole, self.measures, own

    @property
    def key(self) -> dict[str, Any]:
        return {
            "policy": [self.policy, policies.content(self.policy)],
            "code": [package_sources("baselines"), package_sources("agents.learn")],
            "seed": self.seed,
            "environment": _resolved(self.settings),
            "whole": self.whole,
            "measures": [[one.__name__, digest(Path(getfile(one)))] for one in self.measures],
        }


def results(
    tasks: Sequence[Task], store: Store, batch: int = 1, again: bool = False
) -> Generator[tuple[Task, Episode], None, None]:
    """Yield every task with its episode; see `Store.gather`. A policy that holds code is always played."""
    made = {task for task in tasks if again or policies.holds_code(task.policy)}
    apart = any(policies.holds_code(task.policy) for task in tasks)
    files = _files(tasks) if isinstance(store.workers, str) else {}
    with closing(store.gather(tasks, play_tasks, batch, made, apart, files)) as finished:
        for task, arrays in finished:
            yield task, replace(Episode.of(arrays), settings=task.settings)  # another command may have put it otherwise


def collect(
    tasks: Sequence[Task], store: Store, into: dict[Task, Episode] | None = None, again: bool = False
) -> dict[Task, Episode]:
    """The `results`, or those that are over at Ctrl-C; where some fail, ``into`` has the others."""
    found = {} if into is None else into
    try:
        with closing(results(tasks, store, again=again)) as finished:
            found.update(finished)
    except KeyboardInterrupt:
        print("Interrupted; the episodes that are over are kept.")
    return found


def _files(tasks: Sequence[Task]) -> dict[str, Path]:
    """What these tasks need on another machine beside the clone: path in the working folder there → path here."""
    names = {task.policy for task in tasks}
    settings = {task.settings for task in tasks}
    scenarios = (json.loads(one).get("scenario") for one in settings)
    own = {one.partition(":")[0] for one in (*names, *scenarios) if isinstance(one, str) and ":" in one}
    return {**own_files(own.union(*map(foreign_modules, settings))), **policies.files(names)}


def play_tasks(tasks: Sequence[Task]) -> list[Arrays]:
    """Play tasks of one group, several as a batch."""
    first, observers = tasks[0], [[make() for make in task.measures] for task in tasks]
    env = make_environment(json.loads(first.settings), len(tasks), policies.actions_of(first.policy))
    sample_period = 0.0 if first.whole else SAMPLE_PERIOD
    episodes = run_policy(first.policy, env, [task.seed for task in tasks], first.settings, observers, sample_period)
    return [one.arrays() for one in episodes]


def file_name(policy: str) -> str:
    """A policy's name as part of a file's name, of no other policy; of a long one, its end."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", policy)[-100:]
    return plain if plain == policy else f"{plain}-{hashlib.sha256(policy.encode()).hexdigest()[:8]}"


def make_environment(arguments: dict[str, Any], count: int = 1, actions: str = "") -> Any:
    """The environment of every study, or a batch of ``count``. A lost run goes on, or its score would stop there.

    ``actions``: "Continuous" or "Discrete"; on images there are only pairs.
    """
    given = {"end_when_lost": False, **{name: value for name, value in arguments.items() if value is not None}}
    scenario = made_scenario(given.pop("scenario", "paper"))
    fields = {"name": scenario} if isinstance(scenario, str) else {**getattr(scenario, "__dict__", scenario)}
    sensor = fields.get("sensor")
    on_images = sensor == "images" or (fields.get("name") in IMAGE_SCENARIOS and sensor != "corners")
    name = f"ActiveSLAM{'Pixels' if on_images else actions}-v0"
    if count > 1:
        return gym.make_vec(name, num_envs=count, autoreset_mode="DISABLED", num_threads=1, scenario=scenario, **given)
    return gym.make(name, scenario=scenario, **given)


def run_policy(
    source: str,
    env: Any,
    seeds: Sequence[int],
    settings: str = "{}",
    observers: Sequence[Sequence[Observer]] = (),
    sample_period: float = 0.0,
) -> list[Episode]:
    """Episodes of the policy `source` (see `agents.load`), as `play` plays them; `env` is then closed.

    Raises ValueError where the policy cannot be made, or fails with one; whatever a user's code raises becomes one.
    """
    try:
        policy = policies.load(source, env, seeds[0] if len(seeds) == 1 else seeds)
        return play(env, policy, seeds, source, settings, observers, sample_period)
    except Exception as error:
        if not isinstance(error, ValueError) and not policies.holds_code(source):
            raise
        message = str(error)
        if not isinstance(error, ValueError):
            message = f"{policies.described(error)}; allowed: predict(observation, …) that returns (action, state)"
        message = message if source in message else f"policy: {source!r}, episode {seeds[0]}: {message}"
        raise ValueError(message) from error
    finally:
        env.close()


def check(tasks: Iterable[Task]) -> None:
    """Every policy of the tasks takes a step in its environment, so that a mistake is reported before any episode.

    Kernels are then compiled, once, before processes start. A user's code runs in a process of its own. The rate at
    which a saved model decides is printed: its file does not have that of its training.

    Raises:
        ValueError: an unknown policy, one that fails, or a bad argument of an environment.
    """
    steps = {(task.policy, task.settings): (task,) for task in tasks}
    for policy, _ in steps:
        policies.require_known(policy)
    apart = any(policies.holds_code(task.policy) for (task,) in steps.values())
    list(run_all(_step_once, list(steps.values()), 1, None, apart))
    for line in dict.fromkeys(_rate(*step) for step in steps if step[0].endswith(".zip")):
        print(in_a_line(line), flush=True)


def _rate(policy: str, settings: str) -> str:
    """At which rate a saved model is played, and how to choose another."""
    if period := policies.period_of(policy):
        return f"{policy} decides every {period:g} s, as the card beside it says."
    other = '--gaze-period, or {"decision_period": …} in NAME.json beside NAME.zip'
    asked = "" if json.loads(settings).get("gaze_period") else f" Was it trained at another rate? {other}."
    return f"{policy} decides every {_resolved(settings)['gaze_period']:g} s.{asked}"


def _step_once(tasks: tuple[Task]) -> None:
    (task,) = tasks
    try:
        env = make_environment(json.loads(task.settings), actions=policies.actions_of(task.policy))
    except TypeError as error:  # an unknown argument
        raise ValueError(str(error)) from error
    run_policy(task.policy, gym.wrappers.TimeLimit(env, 1), [task.seed])


@cache
def _resolved(settings: str) -> dict[str, Any]:
    """The arguments of `make_environment` with their defaults and every field of the scenario."""
    given = {name: value for name, value in json.loads(settings).items() if value is not None}
    env = make_environment(given)
    core, id = env.unwrapped, env.spec.id
    times = {name: getattr(core, name) for name in ("gaze_period", "motion_period", "duration")}
    defaults = {"end_when_lost": False, "lost_position_error": 0.5, "reward": "entropy"}
    env.close()
    return {**defaults, **given, **times, "id": id, "scenario": fields_of(core.scenario)}
