#!/usr/bin/env bash
# frenet-system-creator 0.3.0: `FrenetSystem.cartesian2ds_frame(point)` returns the distance from a path and the length
# along it. It takes the point of the path that is nearest, by a bounded search of SciPy over the whole path. This finds
# a minimum of a function with one minimum only. The distance to a path with bends has several. Nothing warns. So a
# point of a circuit or of switchbacks is projected to another part of the path. A point that lies on the path is
# reported to be up to 44 m beside it, and the length along a lap jumps back and forth.
# Law: a point of the path has the distance 0. `ds_frame2cartesian` undoes the conversion.
# Documentation: scipy.optimize.minimize_scalar, "Bounded": it finds "a local minimum in the interval".
# Paths without a second minimum are right. `nearest_point` of the package finds the nearest vertex.
# Prints the share of points that are far from where they are, for four paths, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'frenet-system-creator==0.3.0' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from frenet_system_creator import FrenetSystem, nearest_point

print("frenet-system-creator", version("frenet-system-creator"))


def drive(*segments):
    """Vertices, 1 m apart, of a path of ``segments`` (length [m], curvature [1/m])."""
    points, heading = [(0.0, 0.0)], 0.0
    for length, curvature in segments:
        for _ in range(length):
            heading += curvature
            points.append((points[-1][0] + np.cos(heading), points[-1][1] + np.sin(heading)))
    return np.array(points)


PATHS = {
    "straight": drive((300, 0.0)),
    "one corner": drive((50, 0.0), (16, 0.1), (50, 0.0)),
    "circuit": drive((100, 0.0), (62, 0.05), (100, 0.0), (50, 0.05)),
    "switchbacks": drive((80, 0.0), (31, 0.1), (80, 0.0), (31, -0.1), (80, 0.0), (31, 0.1), (80, 0.0)),
}
wrong = {}
for name, path in PATHS.items():
    system = FrenetSystem(path)
    misses, jumps, vertices = [], [], []
    for i in range(1, len(path) - 1, 3):
        (across, along), _ = system.cartesian2ds_frame(tuple(path[i]))
        misses.append(abs(across))
        jumps.append(abs(along - system.s_values[i]))
        vertices.append(nearest_point(path, path[i]) == i)
    wrong[name] = np.mean(np.array(jumps) > 5.0)
    print(f"{name}: of {len(misses)} points of the path, {np.sum(np.array(misses) > 1.0)} are reported beside it, by up"
          f" to {max(misses):.1f} m, and {np.sum(np.array(jumps) > 5.0)} elsewhere on it, by up to {max(jumps):.0f} m")
    assert all(vertices)
right = wrong["straight"] == wrong["one corner"] == 0.0
sys.exit(not (right and wrong["circuit"] > 0.1 and wrong["switchbacks"] > 0.1))
PY
