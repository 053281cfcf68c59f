#!/usr/bin/env bash
# qsp-orientation 0.1.1: `mahony_update` fuses a gyroscope and an accelerometer, and a magnetometer if `mag` is given.
# The library compares the measured field with the horizontal y axis of the world. But the field of the Earth points
# downwards in the north and upwards in the south, in most places by more than 30 degrees. Nothing warns. Accelerometer
# and magnetometer contradict each other, and the filter settles in the middle. The attitude of a level body at rest
# tilts by half the inclination of the field, by 30 degrees for one of 60.
# Law: the attitude of a body at rest agrees with both measurements, if both are right. In the filter of Mahony and
# others, the reference is the measured field itself, turned to the world and then to a horizontal axis there.
# Upstream: no issue of github.com/RQM-Technologies-dev/qsp-orientation that was found describes it.
# The library's `madgwick_update` keeps the body level. `mahony_update` does so with the part of the field that is
# orthogonal to the acceleration.
# Prints the tilt after two minutes for some inclinations, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'qsp-orientation==0.1.1' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from qsp.orientation import madgwick_update, mahony_update, world_to_body

STEP, COUNT, REST = 0.02, 6000, np.zeros(3)
UP = np.array((0.0, 0.0, 1.0))
print("qsp-orientation", version("qsp-orientation"))


def tilt(attitude):
    """Angle [degrees] between the vertical of ``attitude`` and that of the level body."""
    return np.degrees(np.arccos(np.clip(world_to_body(attitude, UP) @ UP, -1.0, 1.0)))


def run(inclination, flat=False):
    """Tilts [degrees] by both filters of a level body at rest; the field is made horizontal if ``flat``."""
    angle = np.radians(inclination)
    field = 50.0 * np.array((np.cos(angle), 0.0, -np.sin(angle)))  # microtesla; the body's x axis points to the north
    if flat:
        field = field - (field @ UP) * UP
    mahony = madgwick = np.array((1.0, 0.0, 0.0, 0.0))
    integral = None
    for _ in range(COUNT):
        mahony, integral = mahony_update(mahony, REST, 9.81 * UP, dt=STEP, integral_error=integral, mag=field)
        madgwick = madgwick_update(madgwick, REST, 9.81 * UP, dt=STEP, mag=field)
    return tilt(mahony), tilt(madgwick)


ok = True
for place, inclination in (("the equator", 0.0), ("Cairo", 45.0), ("Rome", 60.0), ("Oslo", 73.0), ("Sydney", -64.0)):
    (mahony, madgwick), (repaired, _) = run(inclination), run(inclination, flat=True)
    print(f"a level body at {place}, inclination {inclination:g} degrees: tilt by mahony_update {mahony:.1f} degrees,"
          f" by madgwick_update {madgwick:.1f}, by mahony_update with a horizontal field {repaired:.1f}")
    ok &= np.isclose(mahony, abs(inclination) / 2.0, atol=0.5) and madgwick < 0.5 and repaired < 0.5
sys.exit(not ok)
PY
