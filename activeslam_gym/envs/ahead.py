"""``python -m activeslam_gym.envs.ahead`` compiles `evaluate_runs` into the cache, beside a process that compiles more.

See `compilation.SecondProcess`.
"""

from __future__ import annotations

import numpy as np

from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.step import REST, empty_runs, evaluate_runs


def main() -> None:
    """Call it for no run at all, with the types that every environment has."""
    setting = resolve("paper", None, 1.0, 35.0, "entropy", 0.5)
    evaluate_runs(setting.models, setting.task, empty_runs(setting.scenario, 1), np.full(1, REST), 0, 0)


if __name__ == "__main__":
    main()
