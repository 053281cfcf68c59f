"""Policies that take the best action of one step: the paper's three, and others by the same scores."""

from collections.abc import Callable

import numpy as np

from activeslam_gym import Gaze, Motion, core_of
from activeslam_gym.information.candidates import held_plans, motion_plans

from .policy import Actions, Environment, Policy, best

Criterion = str | Callable[..., float]


class Greedy(Policy):
    """The best motion of a criterion once a motion period, the best gaze of another once a gaze period.

    `motion_criterion=None` is the scenario's own (the mutual information of the whole state in the paper's simulation,
    of position and map in its live system); `gaze_criterion=None` turns LEFT all the time. A criterion is a name, or a
    function of your own.
    """

    def __init__(
        self, env: Environment, motion_criterion: Criterion | None = None, gaze_criterion: Criterion | None = None
    ) -> None:
        super().__init__(env)
        self.motion_criterion: Criterion = motion_criterion or self.env.scenario.motion_criterion
        self.gaze_criterion = gaze_criterion

    def choose_motion(self) -> Actions:
        return best(self.per_env(self.env.motion_scores(self.motion_criterion)))

    def choose_gaze(self) -> Actions:
        if self.gaze_criterion is None:
            return self.always(Gaze.LEFT)
        return best(self.per_env(self.env.gaze_scores(self.gaze_criterion)))


class AmortisedGreedy(Greedy):
    """`Greedy`, with one motion evaluated a step and the seven compared when the period is over (the paper, section V).

    The candidates take the last steps of the period, so that their scores are fresh; where it has fewer steps than
    there are motions, several share a step. Where none was evaluated (an episode's first decision) all are at once.
    """

    def __init__(self, env: Environment, **criteria: Criterion | None) -> None:
        super().__init__(env, **criteria)
        self._plans = motion_plans(round(self.env.motion_period / self.env.scenario.frame_time))
        steps = self.env.steps_per_motion
        slots = min(steps - 1, len(Motion))
        self._phase_of_candidate = steps - slots + np.arange(len(Motion)) * slots // len(Motion)
        self._scores = np.full((self.num_envs, len(Motion)), np.nan)

    def decide(self) -> Actions:
        self._scores[self.per_env(self.env.time) == 0] = np.nan
        actions = super().decide()
        self._scores[self.motion_starts()] = np.nan
        self._evaluate_candidates()
        return actions

    def choose_motion(self) -> Actions:
        incomplete = np.isnan(self._scores).any(axis=-1) & self.motion_starts()
        if incomplete.any():
            at_once = self.per_env(self.env.motion_scores(self.motion_criterion))
            self._scores[incomplete] = at_once[incomplete]
        return best(self._scores)

    def _evaluate_candidates(self) -> None:
        """Score the candidates whose turn it is in this step."""
        phase = self.per_env(self.env.motion_phase)
        for motion in Motion:
            turn = phase == self._phase_of_candidate[motion]
            if turn.any():
                score = self.per_env(self.env.scores(self._plans[motion:][:1], self.motion_criterion))
                self._scores[turn, motion] = score[turn, 0]


class JointGreedy(Greedy):
    """The motion of the best pair of a motion and a gaze held for its period; the best gaze at each of its steps.

    A gaze that is held too, as the pair has it, looks into emptiness for a second more than one that is chosen again.
    """

    def choose_motion(self) -> Actions:
        return best(self.per_env(self.env.joint_scores(self.motion_criterion)).max(axis=-1))


class Lookahead(Greedy):
    """The first motion of the best sequence of `horizon` of them, with the covariance propagated along it; MI gaze."""

    def __init__(self, env: Environment, horizon: int = 2) -> None:
        super().__init__(env, gaze_criterion="mutual_information")
        self.horizon = horizon

    def choose_motion(self) -> Actions:
        return best(self.per_env(self.env.lookahead_scores(self.horizon)))


class HeldInformation(Policy):
    """Replans once a motion period: which action, held for the scenario's ``plan_horizon``, has most net information?

    Measurements are predicted at the end of each motion period, one for each of its frames (`information.net`). The
    plans end with the episode. Those on which the standard deviation of the position exceeds the scenario's
    ``plan_position_std`` are taken only where there is no other: then the least uncertain one.
    """

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        frames = round(self.env.motion_period / self.env.scenario.frame_time)
        seconds = min(self.env.scenario.plan_horizon, self.env.duration)
        self._plans = held_plans(frames, max(1, round(seconds / self.env.motion_period)))
        self._gaze = self.always(Gaze.STAY)

    def choose_motion(self) -> Actions:
        net, position_std = map(self.per_env, self.env.forecast(self._plans))
        safe = position_std <= self.env.scenario.plan_position_std
        scores = np.where(safe, net, -np.inf)
        plan = self._plans[best(np.where(safe.any(axis=1, keepdims=True), scores, -position_std)), 0]
        self._gaze = np.where(self.motion_starts(), plan["gaze"], self._gaze)
        return plan["motion"]

    def choose_gaze(self) -> Actions:
        return self._gaze


def greedy(env: Environment, **criteria: Criterion | None) -> Greedy:
    """`AmortisedGreedy` in a scenario that spreads its decisions over the period, `Greedy` elsewhere.

    ``criteria``: the arguments of both, ``motion_criterion`` and ``gaze_criterion``.
    """
    cls = AmortisedGreedy if core_of(env).scenario.amortised_decision else Greedy
    return cls(env, **criteria)
