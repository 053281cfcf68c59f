"""Policies of a few lines, which a policy that decides has to beat: the constants, and rules that look at the map.

They are named as any policy from outside: ``studies.rules:GoBack``, and a constant action by its motion and
its gaze: ``studies.rules:RIGHT_LEFT``.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from activeslam_gym import Gaze, Motion
from baselines.fixed import Planned, Sweep
from baselines.policy import Actions, Environment

UNCERTAIN = 0.06  # standard deviation of the position from which `GoBack` does [m]
ENOUGH = 24  # mapped landmarks from which `Face` does not turn on
PATIENCE = 3.0  # seconds without a new landmark after which `SpinThenOrbit` does [s]
_AHEAD = 0.08  # what is nearer than that to the middle of the view is ahead [rad]


class Rule(Sweep):
    """Moves as `sweep` does, and turns LEFT; a subclass chooses for each state estimate."""

    def beliefs(self) -> Sequence[Any]:
        """The state estimate of each environment."""
        return self.env.belief if self.batched else (self.env.belief,)

    def choose_gaze(self) -> Actions:
        return np.array([self.turn_of(i, belief) for i, belief in enumerate(self.beliefs())])

    def turn_of(self, i: int, belief: Any) -> int:
        """The gaze of environment ``i``."""
        return Gaze.LEFT


class GoBack(Rule):
    """Turns LEFT, and back to the middle of the map while the position is uncertain."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self._returns = np.zeros(self.num_envs, bool)

    def turn_of(self, i: int, belief: Any) -> int:
        std, known = math.sqrt(np.trace(belief.covariance[:3, :3])), belief.landmarks[belief.mapped]
        self._returns[i] = len(known) and std > (0.6 if self._returns[i] else 1.0) * UNCERTAIN
        return gaze_to(belief, known.mean(axis=0)) if self._returns[i] else Gaze.LEFT


class Face(Rule):
    """Turns LEFT until enough is mapped, and then faces the middle of the map."""

    def turn_of(self, i: int, belief: Any) -> int:
        known = belief.landmarks[belief.mapped]
        return gaze_to(belief, known.mean(axis=0)) if len(known) >= ENOUGH else Gaze.LEFT


class SpinThenOrbit(Rule):
    """Turns on the spot until nothing new was mapped for some time, and then circles."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self._most, self._since = np.zeros(self.num_envs, int), np.zeros(self.num_envs)

    def choose_motion(self) -> Actions:
        time = self.per_env(self.env.time)
        mapped = np.array([np.count_nonzero(belief.mapped) for belief in self.beliefs()])
        new = (mapped > self._most) | (time == 0.0)
        self._most, self._since = np.where(new, mapped, self._most), np.where(new, time, self._since)
        return np.where(time - self._since > PATIENCE, Motion.RIGHT, Motion.STAY)


def gaze_to(belief: Any, point: np.ndarray) -> int:
    """The gaze that turns towards a ``point`` (3,)."""
    w, x, y, z = belief.quaternion
    heading = math.atan2(2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y))
    way = point - belief.position
    off = (math.atan2(way[0], way[2]) - heading + math.pi) % (2.0 * math.pi) - math.pi
    return Gaze.STAY if abs(off) < _AHEAD else Gaze.LEFT if off > 0.0 else Gaze.RIGHT


def __getattr__(name: str) -> Callable[[Environment], Planned]:
    """A constant action, by the names of its motion and its gaze."""
    motion, _, gaze = name.partition("_")
    if motion not in Motion.__members__ or gaze not in Gaze.__members__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return lambda env: Planned(env, [(Motion[motion], Gaze[gaze])])
