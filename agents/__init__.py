"""The top floor: comparisons of policies, and policies that learn. `python -m agents --help` lists the commands.

Every episode is a `task.Task`, which `activeslam_gym.evaluation` plays and keeps. On these stand `compare`, `train` and
`export` (with `learn`), `enter`, `verify` and `leaderboard` (in `suite`), and `watch`. All share `tools`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from activeslam_gym.evaluation import Predictor
    from baselines.policy import Environment


def load(name: str | PathLike[str], env: Environment, seed: int | Sequence[int] = 0) -> Predictor:
    """The policy of that name, bound to ``env``. Learned ones need PyTorch, which is imported here.

    Args:
        name: A baseline, shipped weights, a file of weights (policy.npz), a model of Stable-Baselines3 (model.zip),
            'rllib:FOLDER' or the user's own 'package.module:policy'.
        env: The environment, single or a batch, whose belief or time the policy follows.
        seed: Of a random policy; in a batch one for each environment.

    Raises:
        ValueError: there is no such policy, or its weights do not fit the environment's observation.
    """
    from agents import policies

    return policies.load(name, env, seed)
