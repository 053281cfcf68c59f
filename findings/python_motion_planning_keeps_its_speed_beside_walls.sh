#!/usr/bin/env bash
# python-motion-planning 2.1: the controller `RPP`, a regulated pure pursuit, takes `d_prox`, the "proximity distance
# threshold to start slowing down near obstacles", and a gain `alpha`. It computes the slower speed, and writes the
# full speed over it in the next line. Nothing warns. So neither argument has an effect, and the robot passes a wall
# at a distance of 30 cm at its full speed. By the documented rule, the speed is the full one times alpha times the
# distance by d_prox.
# Prints speeds beside a wall, and fails if that changes.
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
from gymnasium import spaces
from python_motion_planning.common import Grid
from python_motion_planning.controller import RPP

DT, SPEED = 0.1, 1.0
grid = Grid(bounds=[[0, 20], [0, 10]], resolution=0.1)
grid.fill_boundary_with_obstacles()  # walls of one cell, up to y = 0.1 m
box = spaces.Box(-np.float32(100.0), np.float32(100.0), (6,)), spaces.Box(-np.float32(100.0), np.float32(100.0), (3,))
found = []
for y in (0.4, 1.0, 5.0):
    distance = y - 0.1
    path = [(x, y, 0.0) for x in np.arange(1.0, 19.0, 0.5)]  # along the wall, so without curvature
    for d_prox, alpha in ((1.0, 0.8), (2.0, 0.1)):
        robot = RPP(*box, dt=DT, path=path, max_lin_speed=SPEED, max_ang_speed=2.0, lookahead_distance=1.0,
                    obstacle_grid=grid, d_prox=d_prox, alpha=alpha)
        action, _ = robot.get_action(np.array([5.0, y, 0.0, 0.0, 0.0, 0.0]))  # at rest: the acceleration to the speed
        truth = SPEED * alpha * distance / d_prox if distance <= d_prox else SPEED
        found.append((float(action[0]) * DT, truth))
        print(f"{distance:.1f} m from the wall, d_prox {d_prox:g} m, alpha {alpha:g}: {found[-1][0]:.3f} m/s,",
              f"by the rule {truth:.3f}")
sys.exit(not (all(abs(speed - SPEED) < 1e-6 for speed, _ in found) and found[0][1] < 0.3 and found[1][1] < 0.1))
PY
