"""The planner over the generalist at three budgets, and one that knows the room: for `compare`, which calls them as
factories."""

from functools import partial

from activeslam_gym.envs.imagination import Hindsight
from agents import pretrained
from baselines.policy import Environment
from baselines.rollout import Rollout

BASE = "generalist"
"""The policy of the plan with which an episode begins, and after each action that is held for some time."""
BUDGETS = {"small": 8, "medium": 24, "large": 72}  # imagined runs for each decision


class Oracle(Rollout):
    """The oracle planner: it knows the true room, but not the noise; its plans are scored over several draws of it."""

    imagination = Hindsight


def planner(env: Environment, budget: int, kind: type[Rollout] = Rollout) -> Rollout:
    """A planner that improves `BASE`, bound to ``env``."""
    from agents.learn.weights import LearnedPolicy, read

    return kind(env, budget, LearnedPolicy(env, *read(BASE, pretrained.FOLDER)).decisions, threads=1)


small, medium, large = (partial(planner, budget=budget) for budget in BUDGETS.values())
oracle = partial(planner, budget=BUDGETS["large"], kind=Oracle)
