#!/usr/bin/env bash
# ins_nav 2023.7.2: `NavigationFrame` is documented to convert between ECEF, NED and ENU. Its `enu2ecef` builds the axis
# that points east from the cosine of the latitude, where the cosine of the longitude belongs. So the axis is neither
# horizontal nor of unit length, and all that is east or west of the origin is misplaced: near Zurich, a point 100 m
# to the east is 31 m off. Nothing warns. `ecef2enu` is right, so the way there and back does not return.
# Law: one direction undoes the other, and keeps distances. PROJ (pyproj 3.7.2, `topocentric`) has the same ECEF.
# Upstream: no issue of github.com/the-guild-of-calamitous-intent/ins_nav that was found describes it.
# `ned2ecef(enu2ned(p))` is right, and so is `enu2ecef` where latitude and longitude are equal.
# Prints the misplacement of points for three origins, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ins_nav==2023.7.2' 'pyproj==3.7.2' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from ins_nav import nav_frames
from pyproj import Transformer

ORIGINS = {"Zurich": (47.4, 8.5, 400.0), "Quito": (-0.2, -78.5, 2850.0), "equal angles": (30.0, 30.0, 0.0)}
POINTS = {"east": (100.0, 0.0, 0.0), "north": (0.0, 100.0, 0.0), "up": (0.0, 0.0, 100.0)}
found = {}
for place, (lat, lon, height) in ORIGINS.items():
    frame = nav_frames.NavigationFrame((lat, lon, height))
    proj = Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={height}")
    origin = np.array(proj.transform(0.0, 0.0, 0.0))
    for direction, point in POINTS.items():
        enu = np.array(point)
        true, by = np.array(proj.transform(*enu)), frame.enu2ecef(enu)
        others = frame.ned2ecef(frame.enu2ned(enu)) - true, frame.ecef2enu(true) - enu
        off, right = np.linalg.norm(by - true), max(np.linalg.norm(other) for other in others) < 1e-6
        back = frame.ecef2enu(by)
        found[place, direction] = off, np.linalg.norm(by - origin), right
        print(f"{place}, 100 m {direction}: off by {off:.2f} m, at a distance of {found[place, direction][1]:.2f} m,",
              f"there and back is ({back[0]:.2f}, {back[1]:.2f}, {back[2]:.2f}); by NED and ecef2enu right: {right}")
ok = all(right for _, _, right in found.values())
ok &= all(off < 1e-6 for (place, direction), (off, _, _) in found.items()
          if direction != "east" or place == "equal angles")
for place in ("Zurich", "Quito"):
    lat, lon = np.radians(ORIGINS[place][:2])
    ok &= abs(found[place, "east"][0] - 100.0 * abs(np.cos(lat) - np.cos(lon))) < 1e-6
sys.exit(not ok)
PY
