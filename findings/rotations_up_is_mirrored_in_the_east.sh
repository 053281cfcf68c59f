#!/usr/bin/env bash
# rotations 0.0.2: `ll2nwu(lat, lon)` of `rotations.frames` returns the matrix that takes vectors from ECEF to north,
# west and up at a place. The second number of its last row has the wrong sign. So the last row is the vertical of the
# place with the opposite longitude. Nothing warns. The matrix is no rotation, except at the longitudes 0 and 180
# degrees. At 90 degrees east on the equator, what goes up by 1 m goes down by 1 m. `ecef2ned` of the same file is
# right.
# Prints vertical vectors and determinants, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'rotations==0.0.2' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from rotations.frames import ecef2ned, ll2nwu

PLACES = ("Greenwich", 51.48, 0.0), ("Zurich", 47.37, 8.54), ("Tokyo", 35.68, 139.69), ("90 E", 0.0, 90.0)
ok = True
for place, lat, lon in PLACES:
    phi, theta = np.radians([lat, lon])
    up = np.array([np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)])  # normal of the ellipsoid
    nwu, ned = ll2nwu(lat, lon), ecef2ned(lat, lon)
    height, opposite = float((nwu @ up)[2]), float(up @ (up * (1.0, -1.0, 1.0)))
    determinant = float(np.linalg.det(nwu))
    print(f"{place}: 1 m upwards is {height:.3f} m up, by ecef2ned {-(ned @ up)[2]:.3f} m;",
          f"the matrix has the determinant {determinant:.3f}")
    ok &= abs(height - opposite) < 1e-9 and np.allclose(ned @ up, (0.0, 0.0, -1.0))
    ok &= (abs(determinant - 1.0) < 1e-9) == (place == "Greenwich")
sys.exit(not (ok and abs(height + 1.0) < 1e-9))
PY
