"""`python -m baselines`: choose the best constant action of every named scenario anew, in its default times.

With names of scenarios it does so for them alone, and keeps what the table holds of the others.
"""

import json
import sys
from collections.abc import Sequence

import gymnasium as gym

from activeslam_gym import SCENARIOS
from activeslam_gym.files import written_whole

from .constants import TABLE, choose, key_of


def main(names: Sequence[str]) -> int:
    """Write the table; the exit status, 2 for an unknown name."""
    if unknown := [name for name in names if name not in SCENARIOS]:
        print(f"scenario: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}", file=sys.stderr)
        return 2
    kept = json.loads(TABLE.read_text(encoding="utf-8")) if names and TABLE.exists() else {}
    table = {key: entry for key, entry in kept.items() if entry["scenario"] not in names}
    for name in names or SCENARIOS:
        env = gym.make("ActiveSLAM-v0", scenario=name).unwrapped
        period, duration = env.motion_period, env.duration  # type: ignore[attr-defined]
        table[key_of(env)] = entry = choose(SCENARIOS[name], period, period, duration)
        print(f"{name}: {entry['medians']}", flush=True)
        with written_whole(TABLE) as unfinished:
            unfinished.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
