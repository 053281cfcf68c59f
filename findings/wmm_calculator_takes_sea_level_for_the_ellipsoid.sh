#!/usr/bin/env bash
# wmm-calculator 1.4.4, the module of NOAA for the World Magnetic Model: `setup_env(lat, lon, alt, msl=True)` is
# documented for altitudes above mean sea level. The library converts such an altitude to the height above the
# ellipsoid, and then computes with the altitude that was given. Nothing warns. So `msl` has no effect: both values
# give the same field, to the last digit. South of India, where the sea is 105 m below the ellipsoid, the field misses
# 2.3 nT. The conversion that the library does not use, `util.alt_to_ellipsoid_height` of geomaglib, is right.
# Prints fields with and without `msl`, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'wmm-calculator==1.4.4' 'geomaglib==1.2.4' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from geomaglib import util
from wmm import wmm_calc


def field(alt, **options):
    """The total intensity [nT] 5 degrees north and 78 degrees east."""
    model = wmm_calc()
    model.setup_time(dyear=2026.0)
    model.setup_env(5.0, 78.0, alt, **options)
    return float(np.squeeze(model.get_all()["f"]))


height = float(np.squeeze(util.alt_to_ellipsoid_height(np.array([0.0]), np.array([5.0]), np.array([78.0]))))  # km
ellipsoid, sea, truth = field(0.0), field(0.0, msl=True), field(height)
gradient = -3.0 * ellipsoid / 6378.0 * height  # of a dipole's field, which falls with the third power of the radius
print(f"sea level is {1000.0 * height:.1f} m from the ellipsoid; field on the ellipsoid {ellipsoid:.4f} nT,",
      f"at sea level {sea:.4f} nT, by the converted height {truth:.4f} nT, a dipole would add {gradient:.1f} nT")
sys.exit(not (sea == ellipsoid and abs(truth - ellipsoid) > 1.0 and abs(truth - ellipsoid - gradient) < 1.5))
PY
