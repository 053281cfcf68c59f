"""Policies that compute, bound to an environment: `baselines.make("mi-fisher", env).predict(observation)`.

They read observations, beliefs and scores, never the truth.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from activeslam_gym.config import did_you_mean
from activeslam_gym.evaluation import bound

from .constants import BestConstant
from .fixed import Orbit, Random, Stay, Sweep
from .greedy import HeldInformation, JointGreedy, Lookahead, greedy
from .policy import Environment, Policy, Predictor, best
from .sequences import BestSequence

__all__ = ["Policy", "Predictor", "best", "make", "names"]

_FACTORIES: dict[str, Callable[..., Policy]] = {
    "random": Random,
    "stay": Stay,
    "sweep": Sweep,
    "orbit": Orbit,
    "best-constant": BestConstant,
    "best-sequence": BestSequence,
    "mi-constant": greedy,
    "mi-mi": partial(greedy, gaze_criterion="mutual_information"),
    "mi-fisher": partial(greedy, gaze_criterion="fisher_trace"),
    "net-net": partial(greedy, motion_criterion="net_information", gaze_criterion="net_information"),
    "fisher-fisher": partial(greedy, motion_criterion="fisher_trace", gaze_criterion="fisher_trace"),
    "variance-reduction": partial(greedy, motion_criterion="variance_reduction", gaze_criterion="variance_reduction"),
    "joint-mi": partial(JointGreedy, gaze_criterion="mutual_information"),
    "lookahead-2": partial(Lookahead, horizon=2),
    "greedy-plus": HeldInformation,
}


def names() -> tuple[str, ...]:
    """The names that `make` knows."""
    return tuple(_FACTORIES)


def make(policy: str | Callable[[Any], Any], env: Environment, **kwargs: Any) -> Predictor:
    """Return the `policy` bound to `env`, single or batched: a name, or a function `policy(env)` of your own.

    A function returns the action of each step, or a policy. `random` takes `seed`.

    Raises ValueError for an unknown name, and lists the known ones.
    """
    if callable(policy):
        return bound(partial(policy, **kwargs) if kwargs else policy, env)
    name = policy
    if name not in names():
        hint = "agents.load(name, env) loads trained policies too"
        raise ValueError(
            f"name: {name!r} is no baseline{did_you_mean(name, _FACTORIES)}; allowed: {', '.join(_FACTORIES)}; {hint}"
        )
    return _FACTORIES[name](env, **kwargs)
