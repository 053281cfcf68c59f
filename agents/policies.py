"""From a policy's name to the policy, wherever it lives."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

import baselines
from agents import load, pretrained
from baselines.policy import Environment, Predictor

Factory = Callable[[Environment, int], Predictor]
"""(environment, seed) -> a policy bound to that environment; the seed serves those that draw."""


def resolve(name: str, env: Environment, seed: int = 0) -> Predictor:
    """Return the policy `name` bound to `env`. Raises ValueError as `factory` does."""
    return factory(name)(env, seed)


def factory(name: str) -> Factory:
    """Return what makes the policy `name`: a baseline, shipped weights, 'policy.npz' or 'package.module:factory'.

    Raises ValueError when no source knows the name, and lists what is allowed.
    """
    path = Path(name)
    if ":" in name:
        make = _imported(name)
        return lambda env, seed: make(env)
    if path.suffix == ".npz":
        if not (path.is_file() and path.with_suffix(".json").is_file()):
            raise ValueError(f"policy: {name!r} is no file with its card ({path.stem}.json) beside it")
        return lambda env, seed: load(path.stem, env, path.parent)
    if name in baselines.names():
        return lambda env, seed: baselines.make(name, env, **({"seed": seed} if name == "random" else {}))
    if name in pretrained.names():
        return lambda env, seed: load(name, env)
    known = ", ".join([*baselines.names(), *pretrained.names()])
    raise ValueError(
        f"policy: {name!r} is unknown; allowed: {known}, a file of weights (policy.npz), 'package.module:factory'"
    )


def _imported(name: str) -> Callable[[Environment], Predictor]:
    """The user's own 'package.module:factory'."""
    module, _, attribute = name.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"policy: {name!r} cannot be imported ({error}); allowed: 'package.module:factory'") from error
