#!/usr/bin/env bash
# pathfinding 1.0.23: `smoothen_path(grid, path, use_raytrace=True)` returns a path "that has less turnings". It looks
# along a straight line, and should keep a corner of the path where the line meets an obstacle. The condition is
# turned around: corners are kept while the line is free, and dropped where it is blocked. Nothing warns. So the
# smooth path goes through walls. In a hundred random maps, all smooth paths do. By default, the lines are of
# Bresenham. Then no line over two steps is blocked, and the path keeps all points but the last but one.
# Prints a path around a wall and a count of maps, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pathfinding==1.0.23' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pathfinding.core.grid import Grid
from pathfinding.core.util import smoothen_path
from pathfinding.finder.a_star import AStarFinder


def hits_wall(free, path):
    """Whether the straight lines of ``path`` pass through the inner part of a cell that is not free."""
    share = np.linspace(0.0, 1.0, 500)[:, None]
    points = np.concatenate([np.subtract(b, a) * share + a for a, b in zip(path, path[1:])])
    cells = np.rint(points).astype(int)
    inner = np.abs(points - cells).max(1) < 0.49
    return not free[cells[inner, 1], cells[inner, 0]].all()


def paths(free):
    grid = Grid(matrix=free.astype(int).tolist())
    found, _ = AStarFinder().find_path(grid.node(0, 0), grid.node(free.shape[1] - 1, 0), grid)
    path = [(node.x, node.y) for node in found]
    return (path, smoothen_path(grid, path, use_raytrace=True), smoothen_path(grid, path)) if len(path) > 2 else None


wall = np.ones((9, 9), bool)
wall[:7, 4] = False
for name, path in zip(("path", "smooth by rays", "smooth by default"), paths(wall)):
    print(f"{name}: {len(path)} points, through the wall: {hits_wall(wall, path)}")
print(f"smooth by rays: {[tuple(point) for point in paths(wall)[1]]}")
rng = np.random.default_rng(0)
counts, kept = np.zeros(3, int), True
while True:
    free = rng.random((20, 20)) > 0.25
    free[0, 0] = free[0, -1] = True
    found = paths(free)
    if found and len(found[0]) > 20:  # not straight
        counts += [1, hits_wall(free, found[0]), hits_wall(free, found[1])]
        kept &= len(found[2]) == len(found[0]) - 1
        if counts[0] == 100:
            break
print(f"random maps: {counts[0]}, with a path through a wall: {counts[1]}, smooth by rays: {counts[2]}; by default one",
      f"point is dropped in each: {kept}")
ok = not hits_wall(wall, paths(wall)[0]) and hits_wall(wall, paths(wall)[1])
sys.exit(not (ok and counts[1] == 0 and counts[2] > 90 and kept))
PY
