#!/usr/bin/env bash
# navigation-utilities 0.2.2: `Oxts.to_coordinate(lat_0, lon_0)` is documented to transform a latitude and a longitude
# to planar coordinates about an origin. Here, x points to the east and y to the north. The library finds the distance
# by the haversine formula, and the direction from the bearing. The bearing needs the cosine of the latitude. The
# library takes the cosine of the longitude. Nothing warns. Beyond the longitudes of 90 degrees, as in Sydney, this
# cosine is negative, and a point to the east gets a negative x. At 90 degrees, a point to the north-east lies straight
# to the north. At the place of the library's own example of a sentence, it is 8 degrees off.
# Law: a turn of the globe about its axis changes no coordinates about an origin that turns along. For small distances,
# x is the difference of the longitudes times the cosine of the latitude, and y is that of the latitudes.
# Upstream: no issue of github.com/pablodorrio/navigation-utilities that was found describes it.
# The distance from the origin is right.
# Prints the coordinates of a point 100 m to the east and 100 m to the north, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'navigation-utilities==0.2.2' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from navigation_utilities.oxts import EARTH_RADIUS, Oxts

SIDE = 100.0  # m
print("navigation-utilities", version("navigation-utilities"))


def coordinates(latitude, longitude):
    """Coordinates [m] of a point ``SIDE`` to the east and to the north of a place [degrees]."""
    step = np.degrees(SIDE / EARTH_RADIUS)
    point = Oxts(latitude + step, longitude + step / np.cos(np.radians(latitude)))
    found = point.to_coordinate(latitude, longitude)
    return np.array((found.x, found.y))


ok = True
places = (("in the Atlantic", 45.0, -45.0), ("the example", 42.2969, -7.8001), ("north of Greenwich", 60.0, 0.0),
          ("at 90 degrees", 45.0, 90.0), ("Sydney", -33.87, 151.21), ("Fiji", -17.7, 178.0))
for name, latitude, longitude in places:
    x, y = coordinates(latitude, longitude)
    bearing = np.degrees(np.arctan2(x, y))
    expected = np.degrees(np.arctan2(np.cos(np.radians(longitude)), np.cos(np.radians(latitude))))
    print(f"{name}, latitude {latitude:g}, longitude {longitude:g}: x {x:.1f} m, y {y:.1f} m, bearing {bearing:.1f}"
          f" degrees, distance {np.hypot(x, y):.2f} m; right are {SIDE:g} m, {SIDE:g} m, 45 degrees,"
          f" {np.hypot(SIDE, SIDE):.2f} m")
    ok &= np.isclose(bearing, expected, atol=0.05) and np.isclose(np.hypot(x, y), np.hypot(SIDE, SIDE), rtol=1e-3)
ok &= np.allclose(coordinates(45.0, -45.0), SIDE, atol=0.1) and coordinates(-33.87, 151.21)[0] < -80.0
sys.exit(not ok)
PY
