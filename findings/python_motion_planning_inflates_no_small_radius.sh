#!/usr/bin/env bash
# python-motion-planning 2.1: `Grid(bounds, resolution, type_map, inflation_radius=r)` is a map with the "radius of
# the inflation" around obstacles, in the units of the world. The constructor inflates nothing where r is below 1.
# Nothing warns, and `inflation_radius` of the grid says r. So for robots of less than a metre, as most are, planned
# paths touch the obstacles. A radius of 1.05 m works, and so does `inflate_obstacles(r)` of the same grid with any
# radius.
# Prints numbers of inflated cells and distances of paths, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'numba==0.68.1' 'matplotlib==3.11.2' 'gymnasium==1.2.3'
"${pip[@]}" --no-deps 'python-motion-planning==2.1' # the rest is for windows and other planners
cd "$folder"
NUMBA_CACHE_DIR="$folder" MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys
from unittest import mock

for name in ("pyvista", "pyvistaqt", "faiss", "osqp"):
    sys.modules[name] = mock.MagicMock()

import numpy as np
from python_motion_planning.common import TYPES, Grid
from python_motion_planning.path_planner import AStar
from scipy.ndimage import distance_transform_edt

RESOLUTION, RADII = 0.1, (0.35, 0.95, 1.05)
obstacles = np.zeros((40, 40), bool)
obstacles[15:25, :25] = True
distances = distance_transform_edt(~obstacles, sampling=RESOLUTION)  # between the centres of cells


def grid(radius):
    types = np.where(obstacles, TYPES.OBSTACLE, TYPES.FREE).astype(np.int8)
    return Grid(bounds=[[0, 4], [0, 4]], resolution=RESOLUTION, type_map=types, inflation_radius=radius)


found = []
for radius in RADII:
    truth = int(((distances <= radius) & ~obstacles).sum())
    built, called = grid(radius), grid(radius)
    called.inflate_obstacles(radius)
    counts = [int((one.data == TYPES.INFLATION).sum()) for one in (built, called)]
    clearance = []
    for one in (built, called):
        path, _ = AStar(map_=one, start=(2, 5), goal=(37, 5)).plan()
        clearance.append(min(float(distances[tuple(cell)]) for cell in path))
    print(f"radius {radius} m, inflation_radius {built.inflation_radius}: {counts[0]} cells inflated, by the method",
          f"{counts[1]}, by SciPy {truth}; the path keeps {clearance[0]:.2f} m, after the method {clearance[1]:.2f} m")
    found.append((counts[0], counts[1] == truth, clearance))
ok = all(same and clearance[1] > radius for (_, same, clearance), radius in zip(found, RADII))
sys.exit(not (ok and found[0][0] == found[1][0] == 0 < found[2][0] and found[0][2][0] < 0.15))
PY
