"""Policies that do not look at the belief: `random`, `stay`, `sweep`, `orbit`, and plans."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion

from .policy import Actions, Environment, Policy


class Random(Policy):
    """Uniform over the motions once a motion period, and over the gazes once a gaze period.

    ``seed``: of all that is drawn; several, one for each environment of a batch: each draws as a single one would.

    Raises:
        ValueError: there are neither one seed nor as many as environments.
    """

    def __init__(self, env: Environment, seed: int | Sequence[int] | None = None) -> None:
        super().__init__(env)
        several = np.ndim(seed) > 0  # type: ignore[arg-type]
        seeds: Any = seed if several else [seed]
        if several and len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} of them; allowed: one, or {self.num_envs}, as many as environments")
        self._generators = [np.random.default_rng(one) for one in seeds]
        self._size = 1 if several else self.num_envs

    def _draw(self, count: int, due: NDArray[np.bool_]) -> Actions:
        """For all environments of one generator; of several, for those that are ``due`` (B,), 0 elsewhere."""
        if len(self._generators) == 1:
            return self._generators[0].integers(count, size=self._size)
        return np.array([one.integers(count) if own else 0 for one, own in zip(self._generators, due)])

    def choose_motion(self) -> Actions:
        return self._draw(len(Motion), self.motion_starts())

    def choose_gaze(self) -> Actions:
        return self._draw(len(Gaze), np.ones(self.num_envs, bool))


class Planned(Policy):
    """Plays a plan (T, 2), motion and gaze of each motion period, or one for each environment of a batch (B, T, 2).

    The last action is held.
    """

    def __init__(self, env: Environment, plan: Any) -> None:
        super().__init__(env)
        self._plans: Actions = np.broadcast_to(plan, (self.num_envs, *np.shape(plan)[-2:]))

    def _now(self) -> Actions:
        period = np.floor(self.per_env(self.env.time) / self.env.motion_period + 1e-9).astype(np.int64)
        return self._plans[np.arange(self.num_envs), np.minimum(period, self._plans.shape[1] - 1)]

    def choose_motion(self) -> Actions:
        return self._now()[:, 0]

    def choose_gaze(self) -> Actions:
        return self._now()[:, 1]


class Sweep(Policy):
    """Turns LEFT all the time and strafes RIGHT and LEFT in turn: simple and strong.

    Each stroke gives one step's length of baseline for the depths, across the line of sight. Since RIGHT is the
    camera's, which turns by ψ between two strokes, a pair of strokes leaves the camera off by about ψ steps, and these
    offsets close a circle within a full turn: the camera stays where the room is free.
    """

    def choose_motion(self) -> Actions:
        period = np.rint(self.per_env(self.env.time) / self.env.motion_period).astype(np.int64)
        return np.where(period % 2 == 0, Motion.RIGHT, Motion.LEFT)

    def choose_gaze(self) -> Actions:
        return self.always(Gaze.LEFT)


Stay = partial(Planned, plan=[(Motion.STAY, Gaze.STAY)])  # stands still and looks ahead: what the others have to beat
Orbit = partial(Planned, plan=[(Motion.RIGHT, Gaze.LEFT)])
"""A circle around what stood ahead, seen from all sides: of a radius of 1.5 m, at 0.3 m/s and 0.2 rad/s."""
