#!/usr/bin/env bash
# akai-transform 1.0.0: `tf3d.quat2rvec(q)` returns the axis and the angle of a quaternion. Where its scalar is above
# 0.9995, the library returns no turn at all. That is a turn of less than 3.6 degrees, about any axis. Nothing warns. A
# camera at 20 Hz that turns by 60 degrees in a second turns by 3 degrees between two images. Added up from the turns of
# its quaternions, it never turns.
# Law: the conversion undoes `rvec2quat`. SciPy 1.17.1 has the true angle, and so has the library's own
# `log_quat.quat2log`.
# Upstream: no report of it was found.
# `log_quat.quat2log`, and `rmat2rvec` of the matrix by `quat2rmat`, are right.
# Prints the angles for some turns, and the sum of the small ones, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'akai-transform==1.0.0' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from akai_transform import log_quat, quat, tf3d
from scipy.spatial.transform import Rotation

AXIS = np.array((1.0, 2.0, 2.0)) / 3.0


def turns(q):
    """Turns of a quaternion as rotation vectors in degrees: `quat2rvec`, `rmat2rvec`, `quat2log`, SciPy."""
    pairs = tf3d.quat2rvec(q), tf3d.rmat2rvec(tf3d.quat2rmat(q))
    vectors = [angle * axis for axis, angle in pairs]
    return np.degrees([*vectors, log_quat.quat2log(q), Rotation.from_quat(q, scalar_first=True).as_rotvec()])


ok = True
for degrees in (0.5, 1.0, 2.0, 3.0, 3.6, 3.7, 5.0, 90.0):
    seen, by_matrix, by_logarithm, true = turns(tf3d.rvec2quat(AXIS, np.radians(degrees)))
    print(f"turn by {degrees:g} degrees: quat2rvec {np.linalg.norm(seen):.3f}, by the matrix"
          f" {np.linalg.norm(by_matrix):.3f}, quat2log {np.linalg.norm(by_logarithm):.3f}")
    ok &= np.allclose(true, degrees * AXIS) and np.allclose((by_matrix, by_logarithm), true, rtol=0.0, atol=1e-6)
    ok &= np.allclose(seen, 0.0 if degrees < 3.62 else true)
total = np.zeros((4, 3))
before = quat.identity()
for frame in range(1, 21):
    now = tf3d.rvec2quat(AXIS, np.radians(3.0 * frame))
    total += turns(quat.multiply(quat.inv(before), now))
    before = now
found = np.linalg.norm(total, axis=1)
print(f"20 images, 3 degrees apart: turned by {found[0]:.3f} degrees by quat2rvec, by {found[2]:.3f} by quat2log")
sys.exit(not (ok and found[0] == 0.0 and np.allclose(found[1:], 60.0)))
PY
