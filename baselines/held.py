"""`greedy-plus`: the first action of the best held action, with measurements predicted on its way."""

import numpy as np

from activeslam_gym import Gaze
from activeslam_gym.information.candidates import held_plans

from .policy import Actions, Environment, Policy, best


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
