#!/usr/bin/env bash
# AttiPy 0.0.7: `AHRS.update` takes a measured heading, `yaw` with `yaw_var`, to correct the heading of its Kalman
# filter. The filter's error is a small rotation of the body. For it, the heading of a level body has the derivative 1,
# whatever the heading. The library takes the derivative for the whole attitude in place of the error, and gets the
# square of cos(yaw / 2). That is 1 to the north, 1/4 at 120 degrees, and 0 to the south. Nothing warns. At 120
# degrees, one measurement turns an error of 10 degrees into one of -31. Near the south, 20 measurements with a noise
# of 1 degree leave a standard deviation of 8 degrees.
# Law: a turn of the world about the vertical changes neither errors nor covariance of a level body. The Kalman filter
# of a heading alone leaves 0.1 degrees of the error, and after 20 measurements a standard deviation of 0.22 degrees.
# Upstream: no issue of github.com/vegardrsolum/attipy that was found describes it.
# Prints the error after measurements for some headings, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'attipy==0.0.7' 'numba==0.68.1' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from attipy import AHRS, Attitude

RATE, DOUBT, NOISE, GRAVITY = 10.0, 10.0, 1.0, 9.80665  # Hz; standard deviations [degrees]; m/s^2
print("AttiPy", version("attipy"))


def run(heading, count):
    """Error and standard deviation [degrees] of a level body at rest after some right measurements of its heading."""
    covariance = 1e-6 * np.eye(9)
    covariance[2, 2] = np.radians(DOUBT) ** 2
    start = Attitude.from_euler((0.0, 0.0, heading + DOUBT), degrees=True)
    ahrs = AHRS(RATE, start, P=covariance)
    for _ in range(count):
        ahrs.update((0.0, 0.0, -GRAVITY), (0.0, 0.0, 0.0), yaw=heading, yaw_var=NOISE**2, yaw_degrees=True)
    error = (ahrs.attitude.as_euler(degrees=True)[2] - heading + 180.0) % 360.0 - 180.0
    return error, np.degrees(np.sqrt(ahrs.P[2, 2]))


right = [DOUBT / (1.0 + (DOUBT / NOISE) ** 2)] + [(DOUBT**-2 + n * NOISE**-2) ** -0.5 for n in (1, 20)]
print(f"error of {DOUBT:g} degrees before; right is {right[0]:.2f} after one measurement, with a standard deviation of"
      f" {right[1]:.2f}, and of {right[2]:.2f} after 20")
found = {}
for heading in (-10.0, 45.0, 90.0, 120.0, 165.0):
    (error, one), (_, many) = run(heading, 1), run(heading, 20)
    found[heading] = error, one, many
    print(f"heading of {heading:g} degrees: {error:.2f} after one measurement, standard deviation {one:.2f}, and"
          f" {many:.2f} after 20")
ok = np.allclose(found[-10.0], right, atol=0.05)
ok &= -4.0 < found[45.0][0] < -1.0 and found[90.0][0] < -10.0 and found[120.0][0] < -25.0
ok &= found[120.0][2] > 3.0 * right[2] and found[165.0][2] > 5.0
sys.exit(not ok)
PY
