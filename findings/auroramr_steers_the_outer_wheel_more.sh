#!/usr/bin/env bash
# AuroraMR 0.3.3: `ackermann_front_steering_angles(delta_center, wheelbase, track_width)` promises the "ideal Ackermann
# front steer angles (left, right)". The inner wheel is nearer to the centre of the turn, so it has to steer more. For a
# left turn, the function says so. For a right turn, it swaps the two wheels: the outer one steers more. Nothing warns.
# The wheels then point to two different centres, and the car of the default sizes would scrub its tires.
# Law: a right turn mirrors a left turn; the normals of both wheels meet the rear axle in one point, the centre.
# Upstream: no public issue of AuroraMR was found.
# For a right turn, swap the two angles.
# Prints the angles and the centres of the wheels for turns to both sides, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'AuroraMR==0.3.3' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import math
import sys
from importlib.metadata import version

from amr.kinematics.integration import ackermann_front_steering_angles
from amr.kinematics.params import AckermannParams

car = AckermannParams()
length, width = car.wheelbase, car.track_width
print("AuroraMR", version("AuroraMR"), f"wheelbase {length} m, track width {width} m")


def centres(left, right):
    """Distances [m] to the left of the rear axle's middle where the normals of the two front wheels meet the axle."""
    return length / math.tan(left) + width / 2.0, length / math.tan(right) - width / 2.0


ok = True
for degrees in (5.0, 15.0, 30.0):
    steer = math.radians(degrees)
    found = {}
    for side in (1.0, -1.0):
        left, right = ackermann_front_steering_angles(side * steer, length, width)
        true = side * length / math.tan(steer)
        found[side] = left, right
        at, swapped = centres(left, right), centres(right, left)
        print(f"{'left' if side > 0 else 'right'} turn of {degrees:g} degrees: wheels at {math.degrees(left):.2f} and"
              f" {math.degrees(right):.2f}; centres at {at[0]:.3f} and {at[1]:.3f} m, swapped at {swapped[0]:.3f} and"
              f" {swapped[1]:.3f}, true {true:.3f}")
        if side > 0:
            ok &= max(abs(c - true) for c in at) < 1e-9
        else:
            ok &= max(abs(c - true) for c in swapped) < 1e-9
            ok &= abs(at[0] - true - width) < 1e-9 and abs(at[1] - true + width) < 1e-9
    ok &= abs(found[-1.0][0] + found[1.0][0]) < 1e-12 and abs(found[-1.0][1] + found[1.0][1]) < 1e-12
    ok &= abs(found[1.0][0]) > abs(found[1.0][1])
sys.exit(not ok)
PY
