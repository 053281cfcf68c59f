#!/usr/bin/env bash
# pykinematics 1.0.1: `imu.utility.calc_derivative(x, dt, order=4)` is documented as a derivative of a sequence, for
# angular accelerations from a gyroscope. The formula of the fourth order takes x[i+2] with the factor -1. The library
# takes it with +1. Nothing warns. So a sixth of the value, divided by the time step, is added to the derivative. The
# derivative of a constant 1 rad/s at 128 Hz is 21 rad/s^2. The first and last two samples have formulas of their own,
# and are right, as is order=2.
# Prints derivatives of a constant and of a sine, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==1.26.4' 'scipy==1.13.1' # the last ones that have scipy.integrate.cumtrapz
"${pip[@]}" --no-deps 'pykinematics==1.0.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pykinematics.imu.utility import calc_derivative

dt = 1.0 / 128.0
t = np.arange(64) * dt
found = {}
for name, rate, truth in (("1 rad/s", np.ones(64), np.zeros(64)), ("sin(6 t)", np.sin(6.0 * t), 6.0 * np.cos(6.0 * t))):
    for order in (2, 4):
        error = calc_derivative(rate, dt, order=order) - truth
        ends = np.abs(np.delete(error, np.s_[2:-2])).max()
        print(f"{name}, order {order}: largest error {np.abs(error).max():.4f} rad/s^2, at the ends {ends:.4f}")
        found[name, order] = error, ends
    extra = found[name, 4][0][2:-2] - rate[4:] / (6.0 * dt)
    print(f"  order 4, less a sixth of the value: {np.abs(extra).max():.6f} rad/s^2")
    found[name] = float(np.abs(extra).max())
names = "1 rad/s", "sin(6 t)"
ok = all(np.abs(found[name, 2][0]).max() < 0.2 and found[name, 4][1] < 0.01 > found[name] for name in names)
sys.exit(not (ok and np.allclose(found["1 rad/s", 4][0][2:-2], 128.0 / 6.0)))
PY
