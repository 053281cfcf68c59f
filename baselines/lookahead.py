"""Receding horizon over motions: `lookahead-2` plans two motion periods and executes the first."""

from .policy import Actions, Environment, Policy, best


class Lookahead(Policy):
    """The first motion of the best sequence of `horizon` of them, with the covariance propagated along it; MI gaze."""

    def __init__(self, env: Environment, horizon: int = 2, gaze_criterion: str = "mutual_information") -> None:
        super().__init__(env)
        if horizon < 1:
            raise ValueError(f"horizon: {horizon} motion periods; allowed: 1 or more")
        self.horizon = horizon
        self.gaze_criterion = gaze_criterion

    def choose_motion(self) -> Actions:
        return best(self.per_env(self.env.lookahead_scores(self.horizon)))

    def choose_gaze(self) -> Actions:
        return best(self.per_env(self.env.gaze_scores(self.gaze_criterion)))
