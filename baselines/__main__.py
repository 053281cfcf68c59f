"""`python -m baselines`: choose `best-constant`, `best-sequence` and the greedy policies' settings for named scenarios.

The settings are fields of the scenarios, where a changed choice has to be entered by hand. Finished episodes are kept
in results/baselines, so that an interrupted command can be resumed.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from activeslam_gym import SCENARIOS
from activeslam_gym.config import IMAGE_SCENARIOS, did_you_mean
from activeslam_gym.evaluation import Store
from activeslam_gym.files import written_whole

from . import constants, readings, sequences
from .constants import Choose, key_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the tables; the exit status: 2 for a mistake, 130 for Ctrl-C."""
    made = argparse.ArgumentParser(prog="python -m baselines", description=__doc__)
    made.add_argument("names", nargs="*", metavar="SCENARIO", help="scenarios to choose for (default: all named ones)")
    made.add_argument("--cluster", help="address of a Ray cluster that plays the open-loop episodes, such as 'auto'")
    args = made.parse_args(arguments)
    names, store = args.names, Store(Path("results/baselines"), args.cluster or 1)
    choices: tuple[tuple[Path, Choose], ...] = (
        (constants.TABLE, constants.choose),
        (sequences.TABLE, sequences.choose_sequence),
        (readings.TABLE, readings.choose_readings),
    )
    try:
        if unknown := [f"{name}{did_you_mean(name, SCENARIOS)}" for name in names if name not in SCENARIOS]:
            raise ValueError(f"scenario: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}")
        for path, choose in choices:
            _renew(path, choose, names, store)
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError, ImportError) as error:
        print(f"python -m baselines: {error}", file=sys.stderr)
        return 2
    return 0


def _renew(path: Path, choose: Choose, names: Sequence[str], store: Store) -> None:
    """Choose again for the ``names``, or for all, in the table ``path``."""
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    table: dict[str, Any] = {key: entry for key, entry in kept.items() if entry["scenario"] in SCENARIOS}
    for name in names or SCENARIOS:
        env: Any = gym.make(f"ActiveSLAM{'Pixels' if name in IMAGE_SCENARIOS else ''}-v0", scenario=name).unwrapped
        entry = choose(env.scenario, (env.motion_period, env.motion_period, env.duration), store)
        table = {key: one for key, one in table.items() if one["scenario"] != name} | {key_of(env): entry}
        print(f"{name}: {entry['medians']}", flush=True)
        with written_whole(path) as unfinished:
            unfinished.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
