"""The top floor: the study that compares policies (`python -m agents compare`), and the policies that learn."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agents.learned import LearnedPolicy
    from baselines.policy import Environment


def load(name: str, env: Environment) -> LearnedPolicy:
    """The shipped policy of that name, bound to ``env``; it needs PyTorch, which is imported here.

    Raises:
        ValueError: there is no such policy, or its weights do not fit the environment's observation.
    """
    from agents.learned import load as load_learned

    return load_learned(name, env)
