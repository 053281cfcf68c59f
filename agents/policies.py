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
    for source in SOURCES:
        found = source(name)
        if found is not None:
            return found
    known = ", ".join([*baselines.names(), *pretrained.names()])
    raise ValueError(
        f"policy: {name!r} is unknown; allowed: {known}, a file of weights (policy.npz), 'package.module:factory'"
    )


def _baseline(name: str) -> Factory | None:
    """A policy of `baselines`, or None."""
    if name not in baselines.names():
        return None
    if name == "random":
        return lambda env, seed: baselines.make(name, env, seed=seed)
    return lambda env, seed: baselines.make(name, env)


def _imported(name: str) -> Factory | None:
    """The user's own 'package.module:factory', called as factory(env); None for a name without a colon."""
    if ":" not in name:
        return None
    module_name, _, attribute = name.partition(":")
    try:
        make = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"policy: {name!r} cannot be imported ({error}); allowed: 'package.module:factory'") from error
    return lambda env, seed: make(env)


def _learned(name: str) -> Factory | None:
    """A policy with shipped weights, or None."""
    if name not in pretrained.names():
        return None
    return lambda env, seed: load(name, env)


def _trained(name: str) -> Factory | None:
    """The weights in a file that `python -m agents train` wrote; None for a name that is no .npz."""
    path = Path(name)
    if path.suffix != ".npz":
        return None
    if not (path.is_file() and path.with_suffix(".json").is_file()):
        raise ValueError(f"policy: {name!r} is no file with its card ({path.stem}.json) beside it")
    return lambda env, seed: load(path.stem, env, path.parent)


SOURCES: tuple[Callable[[str], Factory | None], ...] = (_imported, _trained, _baseline, _learned)
"""Asked in this order; a new kind of policy is one more source."""
