#!/usr/bin/env bash
# Spatial Maths 1.1.18: `pole` of a `Twist2` or `Twist3` is documented as a point on the axis of the motion. The library
# divides a cross product by the angle in place of its square, so the pole is the true one times the angle. For a robot
# that drives a circle about (1, 2), the centre comes out at (0.1, 0.2) for a step of 0.1 rad, and at
# (1.5, 3) for one of 1.5 rad. It is right for an angle of 1 rad alone. The line of a `Twist3`, `line()`, is right.
# Law: the motion leaves its centre where it is; a screw motion moves a point of its axis along the axis alone.
# Upstream: no issue of github.com/bdaiinstitute/spatialmath-python that was found describes it.
# Prints the poles of motions about one centre, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'spatialmath-python==1.1.18' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from spatialmath import SE2, SE3, Twist2, Twist3

CENTRE = np.array((1.0, 2.0))
ok = True
for angle in (0.1, 1.0, 1.5):
    motion = SE2(*CENTRE) * SE2(0.0, 0.0, angle) * SE2(*-CENTRE)
    screw = SE3(*CENTRE, 0.0) * SE3.Rz(angle) * SE3(*-CENTRE, 0.0)
    pole, pole_3d, line = Twist2(motion).pole, Twist3(screw).pole, Twist3(screw).line().pp
    moved = [float(np.linalg.norm(np.ravel(motion * p) - p)) for p in (CENTRE, pole)]
    print(f"angle {angle:g} rad about {CENTRE.tolist()}: pole of Twist2 {pole.round(4)}, of Twist3 {pole_3d.round(4)},",
          f"point of the line {line.round(4)}; the motion moves the centre by {moved[0]:.2g} m, the pole by",
          f"{moved[1]:.2g} m")
    ok &= np.allclose(pole, angle * CENTRE) and np.allclose(pole_3d[:2], angle * CENTRE)
    ok &= np.allclose(line[:2], CENTRE) and moved[0] < 1e-9
sys.exit(not ok)
PY
