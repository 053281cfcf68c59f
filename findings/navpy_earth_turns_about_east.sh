#!/usr/bin/env bash
# NavPy 1.0: `earthrate(lat)` is documented as the rate of the Earth's rotation along north, east and down, which an
# inertial navigation takes off its gyroscopes. It is omega times (cos(lat), 0, -sin(lat)). The library puts the third
# number in the place of the second. So the Earth turns about the east, and never about the vertical. Nothing warns. At
# 45 degrees, exact gyroscopes at rest keep 10.6 degrees/h about east, and as much about the vertical: a heading drifts
# by that in an hour. At the equator it is right, at a pole the axis is horizontal. The length is right everywhere.
# Law: the axis of the Earth is ECEF's z axis, so its rate has no part along east. NavPy's own `ecef2ned`, which takes
# vectors from one frame to the other, has the true rate, and so has pymap3d 3.2.0.
# Upstream: no issue of github.com/NavPy/NavPy that was found describes it.
# `ecef2ned((0.0, 0.0, omega), lat, lon, alt)` is right. `navrate` has its numbers in their places.
# Prints the rates by the three functions, and what is left of gyroscopes at rest, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'navpy==1.0' 'pymap3d==3.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W ignore::SyntaxWarning -W ignore::DeprecationWarning - <<'PY'
import sys

import navpy
import numpy as np
import pymap3d

OMEGA = 7.292115e-5  # rad/s, of WGS 84
HOUR = np.degrees(1.0) * 3600.0  # degrees/h in 1 rad/s
LONGITUDE = 20.0
ok = True
for latitude in (0.0, 30.0, 45.0, -45.0, 60.0, 90.0):
    by_rate = navpy.earthrate(latitude)
    by_vector = np.asarray(navpy.ecef2ned(np.array((0.0, 0.0, OMEGA)), latitude, LONGITUDE, 0.0)).ravel()
    east, north, up = pymap3d.ecef2enuv(0.0, 0.0, OMEGA, latitude, LONGITUDE)
    by_pymap3d = np.array((north, east, -up))
    left = (by_vector - by_rate) * HOUR
    print(f"latitude {latitude:g}: earthrate {(by_rate * HOUR).round(2) + 0.0} degrees/h along north, east and down,",
          f"ecef2ned {(by_vector * HOUR).round(2) + 0.0}, pymap3d {(by_pymap3d * HOUR).round(2) + 0.0};",
          f"left at rest {left.round(2) + 0.0}")
    true = OMEGA * np.array((np.cos(np.radians(latitude)), 0.0, -np.sin(np.radians(latitude))))
    ok &= np.allclose(by_vector, true, rtol=0.0, atol=1e-10) and np.allclose(by_pymap3d, true, rtol=0.0, atol=1e-10)
    ok &= np.allclose(by_rate, true[[0, 2, 1]], rtol=0.0, atol=1e-10)
    if latitude == 45.0:
        ok &= np.allclose(left, (0.0, 10.636, -10.636), rtol=0.0, atol=0.01)
sys.exit(not ok)
PY
