"""``python -m activeslam_gym.envs.ahead`` compiles the kernels of `step` into the cache, beside one with the filter.

See `compilation.SecondProcess`.
"""

from __future__ import annotations

import numpy as np

from activeslam_gym.envs.frame import Entries
from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.step import REST, advance_runs, empty_runs, evaluate_runs
from activeslam_gym.linking import NO_ENTRY


def main() -> None:
    """Call them for no run at all, with the types that every environment has."""
    setting = resolve("paper", None, 1.0, 35.0, "entropy", 0.5)
    models, task, runs, rest = setting.models, setting.task, empty_runs(setting.scenario, 1), np.full(1, REST)
    entries = Entries(NO_ENTRY, NO_ENTRY)
    advance_runs(models, task, runs.simulation, runs.step.status, rest, rest, 0, 0, entries)
    evaluate_runs(models, task, runs, rest, 0, 0)


if __name__ == "__main__":
    main()
