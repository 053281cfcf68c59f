#!/usr/bin/env bash
# Spatial Maths 1.1.18: the logarithm of a planar pose or rotation, `SE2.log`, `SO2.log`, `Twist2` and `base.trlog2`, is
# wrong where the heading has turned by more than 90 degrees. The library takes the arctangent of sin / cos, without
# their signs, so 120 degrees become -60. The exponential of that logarithm is another pose, metres away. Nothing warns.
# Logarithms in space, of `SE3`, are right for the same motions.
# Law: the exponential of the logarithm is the pose itself.
# Upstream: no issue of github.com/bdaiinstitute/spatialmath-python that was found describes it.
# Prints headings and positions before and after, and fails if that changes.
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
from spatialmath import SE2, SE3, SO2, Twist2

found = {}
for degrees in (-120, -80, 80, 100, 120):
    pose = SE2(1.0, 2.0, degrees, unit="deg")
    in_space = SE3(1.0, 2.0, 0.0) * SE3.Rz(degrees, unit="deg")
    again, again_in_space = SE2.Exp(pose.log(twist=True)), SE3.Exp(in_space.log(twist=True))
    assert np.allclose(Twist2(pose).SE2().A, again.A) and np.allclose(again_in_space.A, in_space.A)
    alone = float(np.degrees(SO2(degrees, unit="deg").log(twist=True)))
    found[degrees] = again.theta(unit="deg"), alone, np.linalg.norm(again.t - pose.t)
    print(f"heading {degrees}: exp(log) has {found[degrees][0]:.1f}, at {again.t.round(3)} in place of {pose.t};",
          f"the rotation's log is {alone:.1f} degrees; in space, exp(log) has {again_in_space.rpy(unit='deg')[2]:.1f}")
right = all(np.allclose(found[d], (d, d, 0.0), atol=1e-6) for d in (-80, 80))
wrong = all(np.allclose(found[d][:2], d - np.copysign(180.0, d)) and found[d][2] > 1.0 for d in (-120, 100, 120))
sys.exit(not (right and wrong))
PY
