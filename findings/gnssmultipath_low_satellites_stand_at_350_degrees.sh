#!/usr/bin/env bash
# gnssmultipath 2.2.0: `Geodetic_functions.compute_azimut_elev` returns azimuth and elevation of satellites in
# degrees. Elevations go from -90 to 90. The library maps them to the range from 0 to 360, as it does with an azimuth.
# A test that should return NaN outside of 0 to 90 stores it under a name that nobody reads. Nothing warns. So a
# satellite 10 degrees below the horizon has an elevation of 350 degrees. It passes every cut-off angle, as the
# satellite that is highest. `compute_satellite_azimut_and_elevation_angle` of the same file returns NaN.
# Prints elevations, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'gnssmultipath==2.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from gnssmultipath.Geodetic_functions import compute_azimut_elev, compute_satellite_azimut_and_elevation_angle

a, f = 6378137.0, 1 / 298.257223563
lat, lon = np.radians([47.37, 8.54])
N = a / np.sqrt(1.0 - f * (2.0 - f) * np.sin(lat) ** 2)
receiver = N * np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), (1.0 - f) ** 2 * np.sin(lat)])
up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
east = np.array([-np.sin(lon), np.cos(lon), 0.0])
ok = True
for elevation in (60.0, 5.0, -10.0, -40.0):
    angle = np.radians(elevation)
    satellite = receiver + 2.2e7 * (np.cos(angle) * east + np.sin(angle) * up)
    found = float(compute_azimut_elev(*satellite.tolist(), *receiver.tolist())[1])
    listed = float(compute_azimut_elev(*satellite.reshape(3, 1), *receiver)[1][0])
    other = float(compute_satellite_azimut_and_elevation_angle(*satellite.reshape(3, 1), *receiver)[1][0])
    print(f"elevation {elevation:g}: {found:.6f}, for an array {listed:.6f}, by the other function {other:.6f}")
    ok &= abs(found - elevation % 360.0) < 1e-6 > abs(listed - found) and (np.isnan(other) == (elevation < 0.0))
sys.exit(not ok)
PY
