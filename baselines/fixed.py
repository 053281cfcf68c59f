"""Policies that do not look at the belief: `random`, `stay`, `sweep`, `orbit`."""

import numpy as np

from activeslam_gym import Gaze, Motion

from .policy import Actions, Environment, Policy


class Random(Policy):
    """Uniform over the motions once a motion period, and over the gazes once a gaze period."""

    def __init__(self, env: Environment, seed: int | None = None) -> None:
        super().__init__(env)
        self._generator = np.random.default_rng(seed)

    def choose_motion(self) -> Actions:
        return self._generator.integers(len(Motion), size=self.num_envs)

    def choose_gaze(self) -> Actions:
        return self._generator.integers(len(Gaze), size=self.num_envs)


class Stay(Policy):
    """Stands still and looks ahead: what the others have to beat."""

    def choose_motion(self) -> Actions:
        return self.always(Motion.STAY)

    def choose_gaze(self) -> Actions:
        return self.always(Gaze.STAY)


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


class Orbit(Policy):
    """One constant action, RIGHT with LEFT: a circle around what stood ahead, seen from all sides.

    At 0.3 m/s and 0.2 rad/s its radius is 1.5 m. What decides has to beat it.
    """

    def choose_motion(self) -> Actions:
        return self.always(Motion.RIGHT)

    def choose_gaze(self) -> Actions:
        return self.always(Gaze.LEFT)
