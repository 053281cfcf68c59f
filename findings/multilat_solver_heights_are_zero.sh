#!/usr/bin/env bash
# multilat_solver 2.1.0: `multilateration(..., solver="numpy_lse")` finds a position in space from distances to "4+
# anchors". It subtracts the first equation of a sphere from the others, and solves what is left by least squares. If
# all anchors are in one plane, as on a ceiling, the differences do not depend on the height over it. The least squares
# of NumPy then return the solution with the least norm, whose height is zero in the coordinates of the user. Nothing
# warns. A drone 1.2 m over the floor, with anchors at 3 m, is reported on the floor. The answer depends on the origin:
# if heights count from the ceiling, it is on the ceiling. `z_sign`, which should choose between the two solutions, has
# nothing to choose from. The four exact distances determine the height up to the mirror image in the anchors' plane.
# Law: the distances from the reported position should be those given. Moving the origin should move the answer alike.
# SciPy 1.17.1 finds the height from the same distances.
# Upstream: no issue of github.com/Innopolis-UAV-Team/multilat_solver that was found describes it.
# Horizontal coordinates are right, and with anchors at different heights the height is too.
# Prints positions and residuals for three origins, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'multilat_solver==2.1.0' \
  'numpy==2.4.6' 'scipy==1.17.1' 'pymap3d==3.2.0' 'pyserial==3.5' 'pyyaml==6.0.3'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from multilat_solver.core import multilateration
from scipy.optimize import least_squares

warnings.simplefilter("error")
print("multilat_solver", version("multilat_solver"))
CORNERS = np.array(((0.0, 0.0, 3.0), (6.0, 0.0, 3.0), (6.0, 5.0, 3.0), (0.0, 5.0, 3.0), (3.0, 1.0, 3.0)))
DRONE = np.array((2.0, 3.0, 1.2))
ok = True


def solve(anchors, drone, z_sign):
    """Position by the library, by SciPy from below the anchors, and the largest residual of the first, in m."""
    distances = np.linalg.norm(anchors - drone, axis=1)
    seen = np.array(multilateration(dict(enumerate(distances)), dict(enumerate(map(tuple, anchors))), z_sign,
                                    "numpy_lse"))
    due = least_squares(lambda x: np.linalg.norm(anchors - x, axis=1) - distances,
                        anchors.mean(axis=0) - (0.0, 0.0, 1.0), xtol=1e-14).x
    return seen, due, np.abs(np.linalg.norm(anchors - seen, axis=1) - distances).max()


for origin in (0.0, 3.0, 10.0):
    shift = np.array((0.0, 0.0, origin))
    for z_sign in (0, 1, -1):
        seen, due, residual = solve(CORNERS - shift, DRONE - shift, z_sign)
        print(f"origin at {origin:g} m, z_sign {z_sign}: {np.round(seen, 3) + 0.0}; right is {DRONE - shift}, SciPy"
              f" {np.round(due, 3)}; distances off by up to {residual:.2f} m")
        ok &= np.allclose(seen, (2.0, 3.0, 0.0)) and np.allclose(due, DRONE - shift, atol=1e-6) and residual > 0.3
uneven = CORNERS - np.array((0.0, 0.0, 1.0)) * np.array((0.0, 1.0, 0.0, 2.0, 0.5))[:, None]
seen, due, residual = solve(uneven, DRONE, 0)
print(f"anchors at different heights: {np.round(seen, 3)}; distances off by {residual:.0e} m")
ok &= np.allclose(seen, DRONE) and residual < 1e-9
sys.exit(not ok)
PY
