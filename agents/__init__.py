"""The top floor: what compares policies, and the policies that learn. `python -m agents --help` lists the commands.

Every episode is a `task.Task`, which `activeslam_gym.evaluation` plays and keeps. On these stand `compare` (policies in
the same rooms), `learn` (training, and learned weights as a policy), `honesty` (is the filter consistent?), `study`
(the paper's claims) and `watching`; `tools` is what they share.
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
        folder: Of the weights; those that are shipped if not given.

    Raises:
        ValueError: there is no such policy, or its weights do not fit the environment's observation.
    """
    from agents.learn.weights import load as load_learned

    return load_learned(name, env, folder)
