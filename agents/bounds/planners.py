"""The planner at three budgets, and one that knows the room: for `compare`, which calls them as factories."""

from functools import partial

from activeslam_gym.envs.imagination import Hindsight
from baselines.rollout import Rollout

BUDGETS = {"small": 8, "medium": 24, "large": 72}  # imagined runs for each decision

small, medium, large = (partial(Rollout, budget=budget, threads=1) for budget in BUDGETS.values())


class Clairvoyant(Rollout):
    """The oracle planner: it knows the true room, but not the noise; its plans are scored over several draws of it."""

    imagination = Hindsight


clairvoyant = partial(Clairvoyant, budget=BUDGETS["large"], threads=1)
