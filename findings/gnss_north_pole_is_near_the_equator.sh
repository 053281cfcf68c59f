#!/usr/bin/env bash
# gnss 0.3.1 (Swift Navigation's pygnss): `llh_from_ecef` is documented to return latitude and longitude in degrees. At
# the poles it has a branch of its own, which returns the latitude in radians. Nothing warns. So the north pole is at
# 1.57 degrees of latitude. The way there and back misses the pole by 8900 km. North, east and down are taken from this
# latitude, so a satellite straight above the pole has an elevation of 1.57 degrees in place of 90.
# Law: the conversion undoes `ecef_from_llh`. pymap3d 3.2.0 returns 90 degrees.
# Upstream: no issue of github.com/swift-nav/pygnss that was found describes it.
# A millionth of a degree beside the pole, it is right.
# Prints latitudes, distances and elevations, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gnss==0.3.1' 'numpy==2.4.6' 'pymap3d==3.2.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from gnss.coord_system import azimuth_elevation_from_ecef, ecef_from_llh, llh_from_ecef
from pymap3d import ecef2geodetic

print("gnss", version("gnss"))
ok = True
for latitude in (45.0, 89.0, 89.999999, 90.0, -90.0):
    there = ecef_from_llh((latitude, 0.0, 100.0))
    back, longitude, height = llh_from_ecef(there)
    other = ecef2geodetic(*there)[0]
    off = np.linalg.norm(np.subtract(ecef_from_llh((back, longitude, height)), there))
    satellite = ecef_from_llh((latitude, 0.0, 2.0e7))
    _, elevation = azimuth_elevation_from_ecef(satellite, there)
    print(f"latitude {latitude} degrees: returned as {back:.6f}, by pymap3d as {other:.6f}; there and back misses by"
          f" {off / 1000:.0f} km; a satellite straight above has an elevation of {elevation:.2f} degrees")
    ok &= abs(other - latitude) < 1e-6 and abs(height - 100.0) < 1e-3
    if abs(latitude) == 90.0:
        ok &= abs(back - np.sign(latitude) * np.pi / 2) < 1e-9 and off > 8e6 and elevation < 2.0
    else:
        ok &= abs(back - latitude) < 1e-9 and off < 1e-3 and elevation > 89.99
sys.exit(not ok)
PY
