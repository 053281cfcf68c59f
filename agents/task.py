"""An episode to run, by names: of the policy, of the environment's arguments, of the file that keeps it."""

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

import activeslam_gym  # noqa: F401  (registers the environment)
from agents import policies
from agents.episode import Episode
from agents.evaluate import Look, run_episode
from agents.tools.machine import sources

ENVIRONMENT = "ActiveSLAM-v0"
IMAGES = dict.fromkeys(("pixels", "hand-held-pixels"), "ActiveSLAMPixels-v0")
"""The scenarios whose sensor is a camera in a textured room."""


@dataclass(frozen=True)
class Task:
    """One episode to run."""

    policy: str
    seed: int
    settings: str
    """Arguments of the environment, as JSON: what episodes must share to be compared."""
    whole: bool = False
    """Keep every sample (the room that is drawn) instead of one a second."""
    content: str = ""
    """See `policies.content`; an episode that is kept has it."""

    @property
    def key(self) -> str:
        """What an episode of an earlier run must share to be this one."""
        return " ".join([self.settings, sources(), *filter(None, [self.content])])

    def path(self, folder: Path) -> Path:
        """Where the finished episode is kept."""
        return folder / "episodes" / f"{file_name(self.policy)}-{self.seed}.npz"

    def run(self, looks: Sequence[Look] = ()) -> Episode:
        """Run it, in whichever process."""
        env = make_environment(json.loads(self.settings))
        episode = run_policy(self.policy, env, self.seed, settings=self.key, looks=looks)
        if self.content and policies.content(self.policy) != self.content:
            raise ValueError(f"policy: {self.policy!r} was changed while it was being compared")
        return episode if self.whole else episode.thinned()


def file_name(policy: str) -> str:
    """A policy's name as part of a file's name, of no other policy."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", policy)
    return plain if plain == policy else f"{plain}-{hashlib.sha256(policy.encode()).hexdigest()[:8]}"


def make_environment(arguments: dict[str, Any]) -> gym.Env:
    """The environment of every study. A lost run goes on, or its score would stop where it falls."""
    scenario = arguments.get("scenario")
    name = scenario.get("name") if isinstance(scenario, dict) else scenario
    return gym.make(IMAGES.get(str(name), ENVIRONMENT), **{"end_when_lost": False, **arguments})


def run_policy(
    source: str,
    env: gym.Env,
    seed: int,
    name: str | None = None,
    settings: str = "{}",
    looks: Sequence[Look] = (),
) -> Episode:
    """The episode of `seed` of the policy that `source` names (see `policies.factory`); `env` is closed at its end.

    `name` is what the record calls it, `source` if not given.
    """
    try:
        policy = policies.resolve(source, env, seed)
        policy = policies.Own(source, policy) if ":" in source else policy
        return run_episode(env, policy, seed, name or source, settings, looks)
    except ValueError as error:
        raise ValueError(str(error) if source in str(error) else f"policy: {source!r}, room {seed}: {error}") from error
    finally:
        env.close()


def check(names: Sequence[str], environments: Sequence[dict[str, Any]]) -> None:
    """Raise ValueError for an unknown policy or a bad argument of an environment."""
    for name in names:
        policies.factory(name)
    for arguments in environments:
        make_environment(arguments).close()


def rehearse(names: Sequence[str], environments: Sequence[dict[str, Any]], seed: int) -> None:
    """One step of every policy in every environment, so that kernels are compiled once, before processes start."""
    for arguments in environments:
        for name in names:
            run_policy(name, gym.wrappers.TimeLimit(make_environment(arguments), 1), seed)
