"""The top floor: the study that compares policies (`python -m agents compare`), and the policies that learn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.pretrained import FOLDER

if TYPE_CHECKING:
    from pathlib import Path

    from agents.learned import LearnedPolicy
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
    from agents.learned import load as load_learned

    return load_learned(name, env, folder)
