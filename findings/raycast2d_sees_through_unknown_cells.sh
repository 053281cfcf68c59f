#!/usr/bin/env bash
# raycast2D 0.2.0: `Lidar2D` casts rays in an occupancy grid of "an integer dtype". It is documented to take cells with
# values up to `obstacle_threshold` for occupied. But it converts the grid to 8 bits before it compares.
# That warns of a conversion, not that values change: they are taken modulo 256. So the value -1, with which ROS marks
# unknown cells, becomes 255, and is the freest of all. A ray passes 20 unknown cells and reports the wall behind them.
# In a grid of 16 bits, 256 becomes an obstacle, and 65536 + 5 in one of 32 bits has the value 5.
# Law: comparing the grid as given with the threshold, and casting in the result, of 8 bits, which is not converted.
# Upstream: no issue of github.com/prina404/raycast2D that was found describes it.
# `(grid > threshold).astype("uint8")` with the threshold zero is right.
# Prints where rays end for some values, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'raycast2D==0.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from raycast2D import Lidar2D

print("raycast2D", version("raycast2D"))
SIZE, HERE, FIRST, WALL = 201, 100, 60, 20  # cells; rays run upwards from row 100
messages = set()


def end(grid, threshold):
    """Row where the ray ends."""
    lidar = Lidar2D(num_rays=1, FOV=0, ray_length=HERE - 1, obstacle_threshold=threshold)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lidar.set_map(grid)
    messages.update(str(warning.message) for warning in caught)
    (column, row), = lidar.scan((HERE, HERE, 0.0))
    assert column == HERE
    return int(row)


ok = True
for dtype, free, value, threshold, wrong in (
        ("uint8", 100, 0, 0, False), ("uint8", 100, 50, 50, False), ("int8", 100, 0, 0, False),
        ("int8", 100, -1, 0, True), ("int16", 100, -1, 0, True), ("int32", 100, -1, 50, True),
        ("int16", 100, 0, 0, False), ("int32", 100, -200, 0, True), ("int16", 255, 256, 0, True),
        ("int32", 100, 65541, 10, True)):
    grid = np.full((SIZE, SIZE), free, dtype)
    grid[FIRST - 19:FIRST + 1] = value  # 20 rows of cells
    grid[WALL] = 0
    seen, due = end(grid, threshold), end((grid > threshold).astype("uint8"), 0)
    print(f"{dtype}, free {free}, a band of {value} up to row {FIRST}, wall at row {WALL}, threshold {threshold}: the"
          f" ray ends at row {seen}; right is {due}")
    ok &= due == (FIRST if value <= threshold else WALL)
    ok &= (seen != due) == wrong
print("Warnings:", *sorted(messages), sep="\n  ")
ok &= all(message.endswith("to uint8 for raycasting.") for message in messages)
sys.exit(not ok)
PY
