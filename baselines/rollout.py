"""A planner: plans are played ahead in imagined runs, and the best of them is begun.

At each decision the plan so far is challenged by changes of it: an action held from some time on for some time. All are
played to the end of the episode in the same imagined rooms, which are drawn from the belief (`envs.imagination`), and
by sequential halving: in each round every plan that is left is played in more rooms, and the worse half is dropped. The
plan so far is never dropped, so that a challenger has to beat it in the very rooms in which both were played.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion
from activeslam_gym.envs.imagination import Imagination

from .policy import Actions, Environment, Policy

Plan = NDArray[np.int64]
"""(T, 2) motion and gaze of each motion period."""

CONSTANTS: Plan = np.array([(motion, gaze) for motion in Motion for gaze in Gaze])
"""(21, 2) the constant actions."""
HELD = (1, 2, 3, 5, 8, 12, 20)
"""A change holds its action for one of so many motion periods."""


class Rollout(Policy):
    """The first action of the best plan found, one a motion period; its gaze is held for the whole period.

    ``budget``: imagined runs, to the end of the episode, for each decision. ``base``: the motion and the gaze of the
    plan with which an episode begins. ``seed``: of all that is drawn. ``threads`` share the imagined runs.
    """

    def __init__(
        self,
        env: Environment,
        budget: int = 64,
        base: tuple[int, int] = (Motion.RIGHT, Gaze.LEFT),
        seed: int = 0,
        threads: int | None = None,
    ) -> None:
        super().__init__(env)
        if budget < 4:
            raise ValueError(f"budget: {budget} imagined runs a decision; allowed: 4 or more")
        self._searches = [Search(self.env, i, budget, base, seed, threads) for i in range(self.num_envs)]
        self._gaze = self.always(Gaze.STAY)

    def decide(self) -> Actions:
        for search in self._searches:
            search.imagination.look()
        return super().decide()

    def choose_motion(self) -> Actions:
        action = np.stack((self.motion, self._gaze), axis=-1)
        for i in np.flatnonzero(self.motion_starts()).tolist():
            action[i] = self._searches[i].next_action(bool(self.per_env(self.env.time)[i] == 0))
        self._gaze = action[:, 1]
        return action[:, 0]

    def choose_gaze(self) -> Actions:
        return self._gaze


class Search:
    """The plan of one environment, and how it is bettered."""

    worth = "entropy"

    def __init__(
        self, env: Environment, i: int, budget: int, base: tuple[int, int], seed: int, threads: int | None
    ) -> None:
        self.imagination = Imagination(env, i, seed, threads)
        self._budget, self._base, self._seed = budget, base, seed
        self._rng = np.random.default_rng(seed)
        self.plan: Plan = np.zeros((0, 2), np.int64)
        self.log = []

    def next_action(self, first: bool) -> NDArray[np.int64]:
        """Better the plan, and take its first action off it."""
        if first:
            self._rng = np.random.default_rng(self._seed)
            self.plan = np.tile(self._base, (self.imagination.periods, 1))
        self.plan = self._best(self._challenged(first))
        action, self.plan = self.plan[0], self.plan[1:]
        return action

    def _challenged(self, first: bool) -> NDArray[np.int64]:
        """(n, T, 2) the plan so far and its challengers."""
        T, count = len(self.plan), max(4, self._budget // 4)
        plans = [self.plan]
        if first:
            plans += [np.tile(a, (T, 1)) for a in CONSTANTS]
        while len(plans) < count:
            plans.append(self._changed())
        return np.stack(plans[:max(count, len(plans) if first else 0)])

    def _changed(self) -> Plan:
        plan, T = self.plan.copy(), len(self.plan)
        start = int(self._rng.integers(T)) if self._rng.random() < 0.5 else 0
        length = int(self._rng.choice(HELD))
        plan[start : start + length] = CONSTANTS[self._rng.integers(len(CONSTANTS))]
        return plan

    def _best(self, plans: NDArray[np.int64]) -> Plan:
        """The plan of most worth, by sequential halving; the first of ``plans`` (n, T, 2) is never dropped."""
        left = np.arange(len(plans))
        rounds = int(np.ceil(np.log2(len(plans))))
        shares = []
        n = len(plans)
        for _ in range(rounds):
            shares.append(max(1, round(self._budget / rounds / n)))
            n = max(2, -(-n // 2))
        self.imagination.draw(sum(shares))
        totals, done = np.zeros(len(plans)), 0
        worths = np.zeros((len(plans), sum(shares)))
        for samples in shares:
            rooms = np.tile(np.arange(done, done + samples), len(left))
            out = self.imagination.play(rooms, np.repeat(plans[left], samples, axis=0))
            w = -out.entropy if self.worth == "entropy" else out.log_density
            worths[left, done : done + samples] = w.reshape(len(left), samples)
            done += samples
            totals = worths[:, :done].mean(1)
            challengers = left[left != 0]
            order = challengers[np.argsort(-totals[challengers], kind="stable")]
            left = np.concatenate(([0], order[: max(1, -(-len(left) // 2) - 1)]))
        final = left[1]
        gain = worths[final, :done] - worths[0, :done]
        self.log.append((len(self.plan), gain.mean(), gain.std() / np.sqrt(len(gain)), totals[0]))
        return plans[final] if gain.mean() > 0.0 else plans[0]
