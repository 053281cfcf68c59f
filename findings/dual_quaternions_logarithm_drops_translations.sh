#!/usr/bin/env bash
# dual_quaternions 0.4.0: `log` of a `DualQuaternion` is documented as the map from motions to their tangent space, and
# `exp` as the way back. The logarithm of a pure translation is zero. That of a turn with a translation keeps the angle.
# Of the velocity it loses all that is along the axis, and nearly all where the turn is small. `exp` takes the velocity
# itself for the translation, as if the body did not turn. So neither undoes the other. Nothing warns.
# Law: exp(log(q)) = q. The logarithm of a motion is half of its exponential coordinates, which SciPy 1.17.1 has.
# Upstream: no issue of github.com/Achllle/dual_quaternions that was found describes it.
# `pow` and `sclerp` do not call them, and are right. SciPy's `RigidTransform.as_exp_coords` is a logarithm.
# Prints both logarithms and the way there and back, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'dual_quaternions==0.4.0' 'pyquaternion==0.9.9' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from dual_quaternions import DualQuaternion
from scipy.spatial.transform import RigidTransform

MOTIONS = {  # angular velocity and velocity for one second
    "straight on": [0.0, 0.0, 0.0, 1.0, 2.0, 3.0],
    "turn on the spot": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    "along an arc": [0.0, 0.0, 1.0, 2.0, 0.0, 0.0],
    "along a flat arc": [0.0, 0.0, 0.1, 2.0, 0.0, 0.0],
    "lift of a screw": [0.0, 0.0, 1.0, 0.0, 0.0, 2.0],
}


def translation(pose):
    """The translation of a dual quaternion in metres."""
    return np.array(pose.translation(), float)


found, right = {}, True
for name, coordinates in MOTIONS.items():
    truth = RigidTransform.from_exp_coords(coordinates)
    q = DualQuaternion.from_homogeneous_matrix(truth.as_matrix())
    array = np.array(q.log().dq_array(), float)
    log = 2.0 * np.concatenate([array[1:4], array[5:8]])
    back = q.log().exp()
    half = q.pow(0.5)
    lost = np.linalg.norm(translation(back) - truth.translation)
    found[name] = lost, log
    print(f"{name}: coordinates {coordinates} by SciPy, {(log.round(3) + 0.0).tolist()} by log;",
          f"{truth.translation.round(3)} m become {translation(back).round(3) + 0.0} m by exp(log)")
    right &= np.allclose(truth.as_exp_coords(), coordinates) and np.allclose(log[:3], coordinates[:3])
    right &= np.allclose(q.homogeneous_matrix(), truth.as_matrix())
    right &= np.allclose((half * half).homogeneous_matrix(), truth.as_matrix())
straight, spot, arc, flat, screw = found.values()
wrong = np.allclose(straight[1], 0.0) and np.allclose(straight[0], 14.0**0.5) and np.allclose(screw[0], 2.0)
sys.exit(not (right and wrong and spot[0] < 1e-9 and min(arc[0], flat[0]) > 1.0))
PY
