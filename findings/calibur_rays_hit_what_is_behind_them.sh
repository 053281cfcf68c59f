#!/usr/bin/env bash
# calibur 0.0.1: `BVH.raycast(rays_o, rays_d)` is documented to return the first triangle that each ray hits, and the
# "ray travel distances". It takes the intersection with the least distance, and accepts negative ones. Nothing warns.
# In a closed room, every ray hits the wall behind it, at a negative distance.
# Law: a ray starts at its origin. In a box, the distance to the wall is known in closed form.
# Upstream: no issue of github.com/eliphatfs/calibur that was found describes it.
# Rays that start outside of the mesh's box are right.
# Prints the distances of rays in a room, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'calibur==0.0.1' 'numpy==2.4.6' \
  'typing-extensions==4.16.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version
from itertools import product

import numpy as np
from calibur import BVH

COUNT, HALF = 1000, np.array((3.0, 2.0, 1.5))  # half of the room's sides [m]
print("calibur", version("calibur"))
corners = np.array(list(product((-1.0, 1.0), repeat=3))) * HALF
quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
room = BVH(np.array([corners[list(t)] for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.float32))
random = np.random.default_rng(0)
directions = random.normal(size=(COUNT, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)


def wall(origin, direction):
    """Distances [m] from ``origin``, in the room, to the walls."""
    return np.min((np.sign(direction) * HALF - origin) / direction, axis=1)


def cast(origin):
    hit, distance, _, _ = room.raycast(np.tile(origin, (COUNT, 1)).astype(np.float32), directions.astype(np.float32))
    return hit, distance


inside = np.array((0.7, -0.4, 0.2))
hit, distance = cast(inside)
ahead, behind = wall(inside, directions), wall(inside, -directions)
print(f"in the room: {np.sum(distance < 0.0)} of {COUNT} rays have a negative distance, {distance.min():.2f} to"
      f" {distance.max():.2f} m; the walls ahead are {ahead.min():.2f} to {ahead.max():.2f} m away")
print(f"  off the walls behind the rays by up to {np.abs(distance + behind).max():.1e} m, off those ahead by up to"
      f" {np.abs(distance - ahead).max():.2f} m")
ok = np.all(hit >= 0) and np.all(distance < 0.0) and np.allclose(distance, -behind, atol=1e-4)
outside = np.array((20.0, 0.0, 0.0))
goal = random.uniform(-1.0, 1.0, (COUNT, 3)) * HALF
directions = (goal - outside) / np.linalg.norm(goal - outside, axis=1, keepdims=True)
hit, distance = cast(outside)
near = np.max((-np.sign(directions) * HALF - outside) / directions, axis=1)
print(f"from outside: off by up to {np.abs(distance - near).max():.1e} m")
sys.exit(not (ok and np.allclose(distance, near, atol=1e-4)))
PY
