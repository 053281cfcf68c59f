#!/usr/bin/env bash
# chama 0.3.0: a `Sensor(position, detector)` has a place, and a detector with a threshold and times. The documentation
# has them as independent parts. But the detector stores the points of its first measurement, and ignores the position
# that it gets later. Nothing warns. So sensors of one kind at many places, built with one detector, all measure at the
# place of the one that is asked first. Then all candidates of a placement have the same coverage. The answer depends on
# the order of the calls.
# Law: what a sensor detects depends on its own place, not on other sensors. A detector of its own for each gives that.
# Upstream: no issue of github.com/sandialabs/chama that was found describes it.
# Prints what sensors with one detector and with their own detect, in two orders, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'chama==0.3.0' 'pyomo==6.9.5' \
  'numpy==2.4.6' 'scipy==1.17.1' 'pandas==2.3.3' 'python-dateutil==2.9.0.post0' 'pytz==2026.6' 'tzdata==2026.6' \
  'six==1.17.0' 'ply==3.11'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pandas as pd
from chama.sensors import Point, Sensor, Stationary

print("chama", version("chama"))
PLACES = [(x, 0.0, 0.0) for x in (0.0, 10.0, 20.0, 30.0)]
signal = pd.DataFrame([(0.0, *place, 5.0 + place[0]) for place in PLACES], columns=["T", "X", "Y", "Z", "S"])
signal = signal.set_index(["T", "X", "Y", "Z"])


def detected(places, shared):
    """Signal that a sensor at each place detects."""
    one = Point(threshold=1.0, sample_times=[0.0])
    sensors = [Sensor(position=Stationary(place), detector=one if shared else Point(threshold=1.0, sample_times=[0.0]))
               for place in places]
    return [float(sensor.get_detected_signal(signal).iloc[0]) for sensor in sensors]


ok = True
for places in (PLACES, PLACES[::-1]):
    due = [5.0 + place[0] for place in places]
    own, seen = detected(places, False), detected(places, True)
    print(f"sensors at {[place[0] for place in places]} m: with their own detectors {own}, with one {seen}")
    ok &= np.array_equal(own, due) and np.array_equal(seen, [due[0]] * len(places))
sys.exit(not ok)
PY
