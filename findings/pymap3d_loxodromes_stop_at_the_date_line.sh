#!/usr/bin/env bash
# pymap3d 3.2.0: `lox.loxodrome_inverse` returns length and azimuth of the line of constant course between two places,
# and `lox.departure` the way along a parallel. Across the date line, the first takes the difference of longitudes as it
# is. From 179 degrees east to 179 degrees west, which are 245 km away, it goes around the world by the west: 39189 km.
# On one parallel, both functions take the difference modulo 180 degrees, so 358 degrees, which are 2, count as 178. By
# the same rule, from 0 to 190 degrees east are 10 degrees, where 170 are true. Nothing warns.
# Law: 181 degrees east and 179 west are one meridian, so distances are the same; the library returns 245 km for the
# former. Geodesics by GeographicLib 2.1 agree with it within 1 m.
# Upstream: pull request github.com/geospace-code/pymap3d/pull/66 brought the modulo, for the open issue 65, which tells
# of short ways that came out long; none that was found tells of the date line.
# Add a multiple of 360 degrees to one longitude, so that they differ by 180 at most.
# Prints lengths and azimuths by both spellings of the same places, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pymap3d==3.2.0' 'numpy==2.4.6' 'geographiclib==2.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from geographiclib.geodesic import Geodesic
from pymap3d import lox, rcurve

ok = True
for lat1, lon1, lat2, east, west in ((10.0, 179.0, 11.0, 181.0, -179.0), (10.0, 179.0, 10.0, 181.0, -179.0),
                                     (-17.0, 178.5, -16.0, 180.5, -179.5)):  # the last is near Fiji
    by_east, by_west = (lox.loxodrome_inverse(lat1, lon1, lat2, lon2) for lon2 in (east, west))
    geodesic = Geodesic.WGS84.Inverse(lat1, lon1, lat2, west)["s12"]
    print(f"({lat1}, {lon1}) to ({lat2}, {east} east): {by_east[0] / 1e3:.1f} km by {by_east[1]:.1f} degrees;",
          f"to ({lat2}, {-west} west): {by_west[0] / 1e3:.1f} km by {by_west[1]:.1f} degrees;",
          f"the geodesic has {geodesic / 1e3:.1f} km")
    ok &= geodesic <= by_east[0] < geodesic + 1.0 and by_west[0] > 60.0 * geodesic
    ok &= by_east[1] <= 90.0 and 269.0 < by_west[1] < 271.0
for lon1, lon2, true, taken in ((179.0, -179.0, 2.0, 178.0), (0.0, 190.0, 170.0, 10.0), (0.0, -170.0, 170.0, 170.0),
                                (0.0, 180.0, 180.0, 0.0), (10.0, 12.0, 2.0, 2.0)):
    way, degree = lox.departure(lon1, lon2, 45.0), np.radians(rcurve.parallel(45.0))
    print(f"parallel of 45 degrees, longitudes {lon1} to {lon2}: {way / 1e3:.1f} km, which are {way / degree:.3f}"
          f" degrees; {true * degree / 1e3:.1f} km and {true} degrees are true")
    ok &= abs(way / degree - taken) < 1e-6
sys.exit(not ok)
PY
