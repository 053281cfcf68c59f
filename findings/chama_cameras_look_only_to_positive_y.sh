#!/usr/bin/env bash
# chama 0.3.0: `sensors.Camera(direction=(x, y, z))` is a camera that looks in a direction, for the placement of
# sensors. The library takes arccos(x / |direction|) for the azimuth. This angle lies between 0 and 180 degrees, so the
# sign of y is lost. Nothing warns. A camera that should look along -y looks along +y. It sees a plume behind it, and
# misses one ahead. The arccosine is the azimuth only for level directions with a positive y. For (1, 1, 1), the default
# of the library, it is 54.7 degrees in place of 45.
# Law: mirroring the direction and the plume at the plane y = 0 leaves what is seen.
# Upstream: no issue of github.com/sandialabs/chama that was found describes it.
# Right is arctan2(y, x). With a plume mirrored in y, and a positive y of the direction, the result is right.
# Prints the pixels that see a plume ahead and behind, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'chama==0.3.0' 'pyomo==6.9.5' \
  'numpy==2.4.6' 'scipy==1.17.1' 'pandas==2.3.3' 'python-dateutil==2.9.0.post0' 'pytz==2026.6' 'tzdata==2026.6' \
  'six==1.17.0' 'ply==3.11'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pandas as pd
from chama.sensors import Camera, Sensor, Stationary

print("chama", version("chama"))
AXIS, HEIGHTS = np.arange(-100.0, 101.0, 10.0), np.arange(0.0, 41.0, 10.0)  # m


def pixels(direction, azimuth):
    """Pixels that see a plume 60 m off in an azimuth [degrees], from a camera in the origin, 20 m high."""
    x, y, z = (grid.ravel() for grid in np.meshgrid(AXIS, AXIS, HEIGHTS, indexing="ij"))
    at = 60.0 * np.cos(np.radians(azimuth)), 60.0 * np.sin(np.radians(azimuth))
    plume = np.exp(-0.5 * ((x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - 20.0) ** 2) / 15.0**2)
    signal = pd.DataFrame({"T": 0.0, "X": x, "Y": y, "Z": z, "S": np.where(plume > 0.05, 1e6 * plume, 0.0)})
    camera = Camera(threshold=1, sample_times=[0.0], direction=direction, dist=90.0)
    found = Sensor(position=Stationary((0.0, 0.0, 20.0)), detector=camera).get_detected_signal(
        signal.set_index(["T", "X", "Y", "Z"]))
    return int(found.sum()) if len(found) else 0


ok = True
for azimuth in (30, 60, 90, 120):
    level = (np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0.0)
    mirrored = (level[0], -level[1], 0.0)
    seen = [pixels(direction, side) for direction in (level, mirrored) for side in (azimuth, -azimuth)]
    print(f"direction {azimuth} degrees: {seen[0]} pixels see a plume there, {seen[1]} one at {-azimuth}; direction"
          f" {-azimuth} degrees: {seen[3]} see a plume there, {seen[2]} one at {azimuth}")
    ok &= seen[2] == seen[0] > 50000 and seen[3] == seen[1] < 2000
sys.exit(not ok)
PY
