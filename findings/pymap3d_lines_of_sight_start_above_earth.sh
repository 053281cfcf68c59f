#!/usr/bin/env bash
# pymap3d 3.2.0: `los.lookAtSpheroid(lat0, lon0, h0, az, tilt, ell=...)` intersects a line of sight with the given
# ellipsoid. It places the observer, and reads the point that was hit, on WGS 84 all the same. Nothing warns. So an
# observer 100 km above the Moon looks down at a ground that is 4729 km away, and one 200 m above the ellipsoid of Airy
# finds it 728 m below. A camera that is tilted by 30 degrees at the Moon sees no ground at all (NaN).
# Law: straight down, the distance is the height. From the package's own `geodetic2ecef` of that ellipsoid, a ray of the
# right length ends at height 0 by `ecef2geodetic`. WGS 84, the default, is right.
# Prints distances and the heights where the rays end, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pymap3d==3.2.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from pymap3d import aer2ecef, ecef2geodetic
from pymap3d.ellipsoid import Ellipsoid
from pymap3d.los import lookAtSpheroid
from scipy.optimize import brentq

LAT, LON, AZIMUTH = 50.0, 20.0, 40.0


def height(distance, h0, tilt, ell):
    """Height of the end of a ray above the ellipsoid, all by functions that heed it."""
    x, y, z = aer2ecef(AZIMUTH, tilt - 90.0, distance, LAT, LON, h0, ell=ell)
    return ecef2geodetic(x, y, z, ell=ell)[2]


ok = True
for name, h0 in (("wgs84", 100e3), ("wgs84", 200.0), ("airy", 200.0), ("mars", 100e3), ("moon", 100e3)):
    ell = Ellipsoid.from_name(name)
    for tilt in (0.0, 30.0):
        found = float(lookAtSpheroid(LAT, LON, h0, AZIMUTH, tilt, ell=ell)[2])
        true = brentq(height, 0.9 * h0, 1.6 * h0, args=(h0, tilt, ell))
        end = height(found, h0, tilt, ell)
        print(f"{name}, {h0 / 1e3:g} km high, tilted by {tilt:g} degrees: ground {found / 1e3:.3f} km away, truly"
              f" {true / 1e3:.3f} km; the ray found ends at the height {end / 1e3:.3f} km")
        if name == "wgs84":
            ok &= abs(found - true) < 0.01
        elif name == "moon" and tilt:
            ok &= bool(np.isnan(found))
        else:
            ok &= found > 1.5 * true and abs(end) > 500.0
        ok &= tilt > 0.0 or abs(true - h0) < 0.01
sys.exit(not ok)
PY
