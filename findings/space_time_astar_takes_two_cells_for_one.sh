#!/usr/bin/env bash
# space-time-astar 0.8: its planner searches for a path in space and time. A `State` is equal to another one if their
# hashes are equal. The hash joins the digits of x, y and the time. So the cell (1, 12) at time 3 is 11203, and (11,
# 2) at time 3 too. Of two such cells, the planner visits one, and takes the other for visited. Nothing warns. Where
# the only way to the goal leads through the other one, no path is found. The same map moved by 100 cells, where the
# digits differ, has a path of 44 steps. Each map has 25 x 25 cells.
# Prints the lengths of the paths, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'space-time-astar==0.8' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import itertools
import sys

import numpy as np
from stastar.planner import Planner
from stastar.state import State

BLIND_ALLEY = {(1, y) for y in range(2, 14)}
WAY = {(x, 2) for x in range(1, 16)} | {(15, y) for y in range(2, 21)} | {(x, 20) for x in range(1, 16)}


def shortest(free, start, goal):
    """The number of steps to any of the eight neighbours, by breadth first search."""
    reached, steps = {start}, 0
    while goal not in reached:
        reached |= {(x + i, y + j) for x, y in reached for i, j in itertools.product((-1, 0, 1), repeat=2)} & free
        steps += 1
    return steps


found = {}
for shift in (0, 20, 100):
    free = {(x + shift, y) for x, y in BLIND_ALLEY | WAY}
    walls = [(x + shift, y) for x in range(25) for y in range(25) if (x + shift, y) not in free]
    start, goal = (1 + shift, 2), (1 + shift, 20)
    path = Planner(grid_size=1, robot_radius=0, static_obstacles=walls).plan(start, goal, {}, max_iter=3000)
    found[shift] = len(path) - 1 if len(path) else None
    print(f"moved by {shift}: a path of {found[shift]} steps; the shortest has {shortest(free, start, goal)}")
cells = [State(np.array(cell), 3, 0, 0) for cell in ((1, 12), (11, 2))]
print(f"(1, 12) and (11, 2) at time 3 are equal: {cells[0] == cells[1]}, hashes {[hash(cell) for cell in cells]}")
sys.exit(not (cells[0] == cells[1] and found == {0: None, 20: 44, 100: 44}))
PY
