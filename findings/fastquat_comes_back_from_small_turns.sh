#!/usr/bin/env bash
# FastQuat 0.5.2: `Quaternion.slerp(other, t)` is documented to return itself for t = 0 and `other` for t = 1. Where the
# two are less than 3.6 degrees apart, the function interpolates their numbers, by the weight t (1 - t) in place of t.
# So it goes a quarter of the way, and comes back: for t = 1 it returns the orientation of t = 0. Nothing warns.
# Orientations of an IMU or a camera that follow each other are often that close. Between two of them, a robot that
# turns steadily goes forth and back, and then jumps. Beyond 3.6 degrees, where sines weigh, it is right.
# Law: the documented ends; a steady turn has a steady angle, as by SciPy 1.17.1.
# Upstream: no issue of github.com/CMBSciPol/fastquat that was found describes it.
# Prints angles for turns of 1 to 10 degrees, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'FastQuat==0.5.2' 'jax==0.10.2' 'jaxlib==0.10.2' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
JAX_PLATFORMS=cpu JAX_ENABLE_X64=1 "$folder/venv/bin/python" - <<'PY'
import sys

import jax.numpy as jnp
import numpy as np
from fastquat import Quaternion
from scipy.spatial.transform import Rotation, Slerp

TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)
start = Rotation.from_euler("ZYX", (70.0, 20.0, 10.0), degrees=True)
axis = np.array((2.0, -1.0, 2.0)) / 3.0
found = {}
for degrees in (1.0, 3.5, 3.7, 10.0):
    end = start * Rotation.from_rotvec(np.radians(degrees) * axis)
    a, b = (Quaternion.from_array(jnp.asarray(r.as_quat(scalar_first=True))) for r in (start, end))
    ways = [Rotation.from_quat(np.asarray(a.slerp(b, t).wxyz), scalar_first=True) for t in TIMES]
    true = Slerp((0.0, 1.0), Rotation.concatenate((start, end)))
    angles = [np.degrees((start.inv() * r).magnitude()) for r in ways]
    errors = [np.degrees((r.inv() * true(t)).magnitude()) for r, t in zip(ways, TIMES)]
    found[degrees] = np.array(angles), np.array(errors)
    print(f"{degrees} degrees: for t = {TIMES}, {', '.join(f'{angle:.4f}' for angle in angles)} degrees of it;"
          f" error up to {max(errors):.4f}")
ok = all(found[degrees][1].max() < 1e-5 for degrees in (3.7, 10.0))
for degrees in (1.0, 3.5):
    angles, errors = found[degrees]
    ok &= bool(np.allclose(angles, degrees * np.array([t * (1.0 - t) for t in TIMES]), atol=1e-3 * degrees))
    ok &= abs(errors[-1] - degrees) < 1e-5
sys.exit(not ok)
PY
