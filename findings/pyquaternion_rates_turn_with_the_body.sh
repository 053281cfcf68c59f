#!/usr/bin/env bash
# pyquaternion 0.9.9: `Quaternion.derivative(rate)` and `integrate(rate, timestep)` take "rotation rates about the
# global x, y and z axes". Both multiply the rates from the right, so they turn about the body's axes. Nothing warns. A
# body that is rolled by 90 degrees and turns about the global z axis (its heading) is pitched instead.
# Law: after a turn about a global axis, global vectors are those before it, turned about this axis. SciPy 1.17.1 and
# finite differences say so, and agree with the library only where the rates are those of a gyroscope in the body.
# Upstream: github.com/KieranWynn/pyquaternion/issues/53, open, stumbles on it.
# Prints where the axes point after turns, and errors of the derivative, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pyquaternion==0.9.9' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation


def differences(start, rate, frame, step=1e-6):
    """Derivative of the quaternion (w, x, y, z) by finite differences, for rates about global or body axes."""
    ends = []
    for sign in (1.0, -1.0):
        turn = Rotation.from_rotvec(sign * step * np.array(rate))
        after = turn * start if frame == "global" else start * turn
        q = after.as_quat()[[3, 0, 1, 2]]
        ends.append(q * np.sign(q @ start.as_quat()[[3, 0, 1, 2]]))
    return (ends[0] - ends[1]) / (2.0 * step)


ok = True
for axis, degrees, rate in (("x", 90.0, (0.0, 0.0, 0.5)), ("y", -40.0, (0.3, 0.2, -0.4)), ("z", 90.0, (0.0, 0.0, 0.5))):
    start = Rotation.from_euler(axis, degrees, degrees=True)
    q = Quaternion(start.as_quat()[[3, 0, 1, 2]])
    derivative = q.derivative(rate).elements
    errors = {frame: np.abs(derivative - differences(start, rate, frame)).max() for frame in ("global", "body")}
    q.integrate(rate, 2.0)
    turn = Rotation.from_rotvec(2.0 * np.array(rate))
    found, world, body = (R[:, 0] for R in (q.rotation_matrix, (turn * start).as_matrix(), (start * turn).as_matrix()))
    print(f"turned by {degrees:g} degrees about {axis}, then {rate} rad/s for 2 s: the body's x axis points to"
          f" {found.round(3)}, by global rates to {world.round(3)}; the derivative differs by {errors['global']:.3f}"
          f" from global rates, by {errors['body']:.0e} from rates of the body")
    same = axis == "z"
    ok &= bool(np.allclose(found, body)) and bool(np.allclose(found, world)) == same
    ok &= errors["body"] < 1e-8 and (errors["global"] > 0.05) != same
sys.exit(not ok)
PY
