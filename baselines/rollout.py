"""A planner: plans are played ahead in imagined runs, and the best of them is begun.

At each decision the plan so far is challenged by changes of it: an action, a motion or a gaze held from some time on
for some time. All are played to the end of the episode in the same imagined rooms, which are drawn from the belief (see
`activeslam_gym.envs.imagination`), by sequential halving: in each round every plan that is left is played in new rooms,
and the worse half is dropped. The plan so far is never dropped: the best challenger has to beat it in the rooms of the
last round, which had no part in its choice, by more than the standard error of the difference.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion
from activeslam_gym.envs.imagination import Imagination

from .constants import best_constant
from .policy import Actions, Environment, Policy

Plan = NDArray[np.int64]
"""(T, 2) motion and gaze of each motion period."""

HELD = (1, 2, 3, 5, 8, 13, 1000)
"""A change is held for one of so many motion periods, or to the end."""
NOW = 0.5
"""Share of the changes that begin at once."""
RUNS_PER_PLAN = 4
"""The budget is so many runs for each plan."""
FEWEST_RUNS = 8


class Rollout(Policy):
    """The first action of the best plan found, once a motion period; its gaze is held for the whole period.

    ``budget``: imagined runs, to the end of the episode, for each decision. ``base``: motion and gaze of the plan with
    which an episode begins (None: the best constant). ``seed``: of all that is drawn. ``threads`` share the imagined
    runs (None: one for each core).

    Raises:
        ValueError: the budget is under 8 runs.
    """

    imagination: type[Imagination] = Imagination

    def __init__(
        self,
        env: Environment,
        budget: int = 64,
        base: tuple[int, int] | None = None,
        seed: int = 0,
        threads: int | None = None,
    ) -> None:
        super().__init__(env)
        if budget < FEWEST_RUNS:
            raise ValueError(f"budget: {budget} imagined runs a decision; allowed: {FEWEST_RUNS} or more")
        imaginations = [self.imagination(self.env, i, seed, threads) for i in range(self.num_envs)]
        self._searches = [Search(one, budget, base or best_constant(self.env), seed) for one in imaginations]
        self._gaze = self.always(Gaze.STAY)

    def decide(self) -> Actions:
        for search in self._searches:
            search.imagination.look()
        return super().decide()

    def choose_motion(self) -> Actions:
        actions = np.stack((self.motion, self._gaze), axis=-1)
        first = self.per_env(self.env.time) == 0
        for i in np.flatnonzero(self.motion_starts()).tolist():
            actions[i] = self._searches[i].next_action(bool(first[i]))
        self._gaze = actions[:, 1]
        return actions[:, 0]

    def choose_gaze(self) -> Actions:
        return self._gaze


class Search:
    """The plan of one environment, and how it is bettered."""

    def __init__(self, imagination: Imagination, budget: int, base: tuple[int, int], seed: int) -> None:
        self.imagination = imagination
        self.plan: Plan = np.zeros((0, 2), np.int64)
        self._budget, self._base, self._seed = budget, base, seed
        self._rng = np.random.default_rng(seed)

    def next_action(self, first: bool) -> NDArray[np.int64]:
        """(2,) the first action of the bettered plan; ``first`` of an episode."""
        if first:
            self._rng = np.random.default_rng(self._seed)
        self.plan = self._rest(self.plan[:0] if first else self.plan)
        if self.imagination.possible:
            challengers = [self._changed() for _ in range(self._budget // RUNS_PER_PLAN - 1)]
            self.plan = self._best(np.stack([self.plan, *challengers]))
        return self.plan[0]

    def _rest(self, plan: Plan) -> Plan:
        """What is left of a plan: its last actions, one for each period to come; the base's where it has too few."""
        periods = self.imagination.periods
        base = np.tile(np.array(self._base, np.int64), (periods, 1))
        return np.concatenate((plan, base[len(plan) :]))[-periods:]

    def _changed(self) -> Plan:
        """The plan with one change."""
        plan, rng = self.plan.copy(), self._rng
        start = 0 if rng.random() < NOW else int(rng.integers(len(plan)))
        part = slice(start, start + int(rng.choice(HELD)))
        what = rng.integers(3)  # motion, gaze or both
        if what != 1:
            plan[part, 0] = rng.integers(len(Motion))
        if what != 0:
            plan[part, 1] = rng.integers(len(Gaze))
        return plan

    def _best(self, plans: NDArray[np.int64]) -> Plan:
        """The best of ``plans`` (n, T, 2) by sequential halving, or the first, which is never dropped."""
        schedule = list(halvings(len(plans), self._budget))
        self.imagination.draw(sum(rooms for _, rooms in schedule))
        left, totals, done = np.arange(len(plans)), np.zeros(len(plans)), 0
        for keep, rooms in schedule:
            worths = self._worths(plans[left], np.arange(done, done + rooms))
            done += rooms
            lead = worths[1] - worths[0]  # of use in the last round
            totals[left] += worths.sum(axis=1)
            challengers = left[1:][np.argsort(-totals[left[1:]], kind="stable")]
            left = np.concatenate((left[:1], challengers[: keep - 1]))
        sure = lead.mean() > lead.std(ddof=1) / math.sqrt(len(lead))
        return plans[left[1] if sure else 0]

    def _worths(self, plans: NDArray[np.int64], rooms: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, m) how much entropy is removed by the end by each of ``plans`` in each of ``rooms`` (m,) [bit]."""
        each = np.repeat(plans, len(rooms), axis=0)
        outcome = self.imagination.play(np.tile(rooms, len(plans)), each)
        return -outcome.entropy.reshape(len(plans), len(rooms))


def halvings(plans: int, budget: int) -> Iterator[tuple[int, int]]:
    """The rounds of sequential halving: how many plans each keeps, and in how many new rooms it plays those left.

    The rounds share the budget of runs about equally; each has at least one room.
    """
    rounds = math.ceil(math.log2(plans))
    for _ in range(rounds):
        keep = max(2, math.ceil(plans / 2))
        yield keep, max(1, round(budget / rounds / plans))
        plans = keep
