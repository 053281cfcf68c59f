"""A policy of your own: choose a motion and a gaze, for one environment or a batch, and enter the comparison."""

import numpy as np

from activeslam_gym import Gaze
from baselines import Policy, best
from baselines.policy import Actions, Environment


class LookAround(Policy):
    """The motion by mutual information; the gaze turns LEFT until nothing is expected any more, and then rests."""

    def choose_motion(self) -> Actions:
        """(B,) asked for only where a motion period starts."""
        return best(self.per_env(self.env.motion_scores("mutual_information")))

    def choose_gaze(self) -> Actions:
        """(B,) asked for in every step."""
        return np.where(self.waiting() > 0, int(Gaze.LEFT), int(Gaze.STAY))

    def waiting(self) -> Actions:
        """(B,) landmarks that no mapped feature stands for, as far as the belief can tell."""
        beliefs = self.env.belief if self.batched else [self.env.belief]
        return np.array([max(0, self.env.scenario.landmark_count - int(belief.mapped.sum())) for belief in beliefs])


def make(env: Environment) -> LookAround:
    """What `--policies examples.extend_policy:make` calls."""
    return LookAround(env)


if __name__ == "__main__":
    import gymnasium as gym

    from activeslam_gym.evaluation import run_episode

    env = gym.make("ActiveSLAM-v0", duration=10.0)
    print(f"{run_episode(env, make(env), seed=0).landmarks_mapped[-1]} landmarks mapped in 10 s")
