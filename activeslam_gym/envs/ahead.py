"""``python -m activeslam_gym.envs.ahead`` compiles the kernels of `step` into the cache, beside one with the filter.

See `compilation.SecondProcess`.
"""

from __future__ import annotations

import numpy as np

from activeslam_gym.envs.frame import FilterEntries
from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.step import REST, empty_runs, entries_of, play_runs
from activeslam_gym.linking import NO_ENTRY


def main() -> None:
    """Play no run at all, of the types that every run has, and without a filter."""
    setting = resolve("paper", None, 1.0, 35.0, "entropy", 0.5)
    without_filter = FilterEntries(NO_ENTRY, NO_ENTRY)
    models, task, runs, rest = setting.models, setting.task, empty_runs(setting.scenario, 1), np.full(1, REST, np.int64)
    play_runs(models, task, runs, rest, rest, 0, 0, entries_of(models, task, runs, rest, rest, without_filter))


if __name__ == "__main__":
    main()
