#!/usr/bin/env bash
# baglab 1.1.0: `delay_estimate(cmd, response, t)` estimates the delay of a robot's response to a command, of a ROS bag,
# by "cross-correlation". It correlates the signals as they are, without taking off their means. Beyond their ends they
# count as zero, so the overlap of the means is largest without any delay. Nothing warns. A delay of half a second is
# right for signals about zero. If the speed varies about 2 m/s, it is estimated too short, and about 5 m/s, there is
# none.
# Law: a constant that is added to both signals does not change the delay between them.
# Upstream: no issue of github.com/Kotakku/baglab that was found describes it.
# Without the means, as `cmd - cmd.mean()`, the delay is right.
# Prints the delay for some offsets, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'baglab==1.1.0' 'numpy==2.4.6' 'pandas==3.1.1' \
  'scipy==1.17.1'
cd "$folder"
MPLBACKEND=Agg "$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pandas as pd
from baglab import delay_estimate

DELAY, STEP = 0.5, 0.02  # s
print("baglab", version("baglab"))
time = pd.Series(np.arange(0.0, 20.0, STEP))


def speed(t):
    """Speed [m/s] of a vehicle, whose mean is about zero."""
    return np.sin(0.9 * t) + 0.5 * np.sin(2.3 * t + 1.0)


found = {}
for offset in (0.0, 1.0, 2.0, 5.0, 10.0):
    command, response = offset + speed(time), offset + speed(time - DELAY)
    found[offset] = delay_estimate(command, response, time)
    centred = delay_estimate(command - command.mean(), response - response.mean(), time)
    print(f"speed about {offset:g} m/s: delay of {found[offset]:.2f} s, without the means {centred:.2f} s;"
          f" true {DELAY:.2f} s")
    found[offset] = found[offset], centred
ok = all(abs(centred - DELAY) <= 1.5 * STEP for _, centred in found.values())
ok &= abs(found[0.0][0] - DELAY) <= STEP and 0.1 < found[2.0][0] < DELAY - 0.1
ok &= found[5.0][0] == 0.0 and found[10.0][0] == 0.0
sys.exit(not ok)
PY
