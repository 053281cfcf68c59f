"""A planner: plans are played ahead in imagined runs, and the best of them is begun.

An episode begins with the best sequence as the plan (see `baselines.sequences`). At each decision it is challenged by
changes of it: from some time on and for some time another action, motion or gaze is held, or put in between, or what
was planned is left out, or the rest is done the other way round. All are played to the end of the episode in the same
imagined rooms, which are drawn from the belief (see `activeslam_gym.envs.imagination`), by sequential halving: in each
round every plan that is left is played in new rooms, and the worse half is dropped. The plan so far is never dropped:
the best challenger has to beat it in the rooms of the last round, which had no part in its choice, by `SURE` standard
errors of the difference.

Runs are judged by the log score, which tells a belief that is confidently wrong from one that is right; the entropy,
which does not, was tried. One such run in a hundred would outweigh all others, so that none counts as more than `WORST`
bits below the best beside it.

In place of the sequence the plan may be a policy, which decides in the imagined runs too: the policy is then improved
by one step of policy iteration (the rollout algorithm; Bertsekas, Tsitsiklis and Wu, 1997). A change is an action that
is held for some time before the policy decides again.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion
from activeslam_gym.envs.imagination import DECIDED, Decide, Imagination

from .policy import Actions, Environment, Policy
from .sequences import Sequence, best_sequence, constant

OTHER = {"LEFT": "RIGHT", "RIGHT": "LEFT"}
Plan = NDArray[np.int64]  # (T, 2) motion and gaze of each motion period

HELD = (1, 2, 3, 5, 8, 13, 1000)  # a change is held for one of so many motion periods, or to the end
NOW = 0.5  # share of the changes that begin at once
KINDS = {"hold": 0.5, "insert": 0.25, "skip": 0.1, "mirror": 0.15}  # kinds of changes, and their shares
MIRRORED = tuple(np.array([one[OTHER.get(of.name, of.name)] for of in one]) for one in (Motion, Gaze))
"""Of each motion, and of each gaze, that to the other side."""
SURE = 2.0  # a challenger has to lead by so many standard errors of the lead
WORST = 1000.0  # no imagined run counts as more than this below the best one beside it [bit]
RUNS_PER_PLAN = 4  # the budget is so many runs for each plan
FEWEST_RUNS = 8


class Rollout(Policy):
    """The first action of the best plan found, once a motion period; its gaze is held for the whole period.

    ``budget``: imagined runs, to the end of the episode, for each decision. ``base``: the plan with which an episode
    begins, a sequence, or motion and gaze of a constant (None: the scenario's best sequence); or a policy that decides
    once a motion period. ``seed``: of all that is drawn. ``threads`` share the imagined runs (None: one for each core).

    Raises:
        ValueError: the budget is under 8 runs.
    """

    imagination: type[Imagination] = Imagination

    def __init__(
        self,
        env: Environment,
        budget: int = 64,
        base: Sequence | tuple[int, int] | Decide | None = None,
        seed: int = 0,
        threads: int | None = None,
    ) -> None:
        super().__init__(env)
        if budget < FEWEST_RUNS:
            raise ValueError(f"budget: {budget} imagined runs a decision; allowed: {FEWEST_RUNS} or more")
        imaginations = [self.imagination(self.env, i, seed, threads) for i in range(self.num_envs)]
        begun = base or best_sequence(self.env)
        begun = begun if isinstance(begun, Sequence) or callable(begun) else constant(begun)
        self._searches = [Search(one, budget, begun, seed) for one in imaginations]
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

    def __init__(self, imagination: Imagination, budget: int, base: Sequence | Decide, seed: int) -> None:
        self.imagination = imagination
        self.plan: Plan = np.zeros((0, 2), np.int64)
        self._budget, self._base, self._seed = budget, base, seed
        self._decide = None if isinstance(base, Sequence) else base
        self._rng = np.random.default_rng(seed)

    def next_action(self, first: bool) -> NDArray[np.int64]:
        """(2,) the first action of the bettered plan; ``first`` of an episode."""
        if first:
            self._rng = np.random.default_rng(self._seed)
        self.plan = self._rest(self.plan[:0] if first else self.plan)
        if self.imagination.possible:
            challengers = [self._changed() for _ in range(self._budget // RUNS_PER_PLAN - 1)]
            if self._decide and (self.plan != DECIDED).any():
                challengers[0] = np.full_like(self.plan, DECIDED)
            self.plan = self._best(np.stack([self.plan, *challengers]))
        return self.imagination.decided(self._decide) if self._decide and DECIDED in self.plan[0] else self.plan[0]

    def _rest(self, plan: Plan) -> Plan:
        """What is left of a plan, one action for each period to come; of an empty one, the base's."""
        periods = self.imagination.periods
        if not len(plan):
            plan = self._base.plan(periods) if isinstance(self._base, Sequence) else np.full((periods, 2), DECIDED)
        return _as_long(plan, periods)[-periods:]

    def _changed(self) -> Plan:
        """The plan with one change."""
        plan, rng = self.plan.copy(), self._rng
        if self._decide:
            plan[:] = DECIDED
            plan[: int(rng.choice(HELD))] = rng.integers(len(Motion)), rng.integers(len(Gaze))
            return plan
        start = 0 if rng.random() < NOW else int(rng.integers(len(plan)))
        held = min(int(rng.choice(HELD)), len(plan) - start)
        end, new = start + held, np.array([rng.integers(len(Motion)), rng.integers(len(Gaze))])
        kind = rng.choice(list(KINDS), p=list(KINDS.values()))
        if kind == "mirror":
            plan[start:, 0], plan[start:, 1] = MIRRORED[0][plan[start:, 0]], MIRRORED[1][plan[start:, 1]]
        elif kind == "insert":
            plan = np.concatenate((plan[:start], np.tile(new, (held, 1)), plan[start:]))
        elif kind == "skip":
            plan = np.concatenate((plan[:start], plan[end:], plan[-1:]))
        else:
            which = [[0], [1], [0, 1]][rng.integers(3)]
            plan[start:end, which] = new[which]
        return _as_long(plan, len(self.plan))[: len(self.plan)]

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
        sure = lead.mean() > SURE * lead.std(ddof=1) / math.sqrt(len(lead))
        return plans[left[1] if sure else 0]

    def _worths(self, plans: NDArray[np.int64], rooms: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, m) the log density of what is true, at the end of each of ``plans`` in each of ``rooms`` (m,) [bit]."""
        each = np.repeat(plans, len(rooms), axis=0)
        outcome = self.imagination.play(np.tile(rooms, len(plans)), each, self._decide)
        worths = outcome.log_density.reshape(len(plans), len(rooms))
        return np.maximum(worths, worths.max() - WORST)


def _as_long(plan: Plan, periods: int) -> Plan:
    """``plan``, its last action repeated where it has fewer ``periods``."""
    return np.concatenate((plan, np.tile(plan[-1], (max(periods - len(plan), 0), 1))))


def halvings(plans: int, budget: int) -> Iterator[tuple[int, int]]:
    """The rounds of sequential halving: how many plans each keeps, and in how many new rooms it plays those left.

    The rounds share the budget of runs about equally; each has at least one room.
    """
    rounds = math.ceil(math.log2(plans))
    for _ in range(rounds):
        keep = max(2, math.ceil(plans / 2))
        yield keep, max(1, round(budget / rounds / plans))
        plans = keep
