"""The top floor: comparisons of policies, and policies that learn. `python -m agents --help` lists the commands.

Every episode is a `task.Task`, which `activeslam_gym.evaluation` plays and keeps. The commands stand on these:
`compare` and `bounds` (policies in the same rooms), `consistency` (of the filter), `study` and `live` (the paper's
claims), `train` and `export` (with `learn`), and `watch`. `tools` is shared by all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.pretrained import FOLDER

if TYPE_CHECKING:
    from pathlib import Path

    from agents.learn.weights import LearnedPolicy
    from baselines.policy import Environment


def load(name: str, env: Environment, folder: Path = FOLDER) -> LearnedPolicy:
    """The learned policy of that name, bound to ``env``; it needs PyTorch, which is imported here.

    Args:
        name: Stem of a file of weights in ``folder``.
        env: The environment, single or a batch, whose time the policy follows.
        folder: Of the weights; the shipped ones if not given.

    Raises:
        ValueError: there is no such policy, or its weights do not fit the environment's observation.
    """
    from agents.learn.weights import LearnedPolicy, read

    return LearnedPolicy(env, *read(name, folder))
