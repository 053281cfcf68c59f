#!/usr/bin/env bash
# satellogic-quaternions 0.1.8: a `Quaternion` is an orientation, and equal up to sign. `distance` knows the sign: where
# those of two neighbours differ, it is a turn minus the angle between them. `from_matrix` makes the largest component
# positive, so signs differ at both sides of a roll of 90 degrees. Of attitudes within a degree there,
# `average_and_std_naive` gives a standard deviation of 254 degrees. Nothing warns.
# `distance` is `rotation_angle` of the quotient: the length of twice its logarithm, which is documented as below one
# turn. It never takes the shorter of both ways.
# Law: q and -q are one orientation, with one distance to any other. No angle between orientations exceeds 180 degrees.
# Upstream: no issue of github.com/satellogic/quaternions that was found describes it.
# The smaller of the distance and a turn minus the distance is right.
# Prints distances and spreads at three attitudes, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'satellogic-quaternions==0.1.8' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from quaternions import Quaternion
from scipy.spatial.transform import Rotation

ok = True
for name, angles in {"level": (0, 0, 0), "rolled by 90": (0, 0, 90), "heading 90, rolled by 180": (90, 0, 180)}.items():
    mean = Rotation.from_euler("ZYX", angles, degrees=True)
    near = [mean * Rotation.from_euler("x", degrees, degrees=True) for degrees in (-1.0, -0.5, 0.5, 1.0)]
    found = [Quaternion.from_matrix(rotation.as_matrix()) for rotation in near]
    assert all(np.allclose(q.matrix, r.as_matrix()) for q, r in zip(found, near))
    distance = np.degrees(found[0].distance(found[3]))
    true = np.degrees((near[0].inv() * near[3]).magnitude())
    average, spread = Quaternion.average_and_std_naive(*found)
    right = np.degrees(np.sqrt(np.mean([min(d, 2.0 * np.pi - d) ** 2 for d in map(average.distance, found)])))
    centre = Rotation.from_matrix(average.matrix)
    by_scipy = np.degrees(np.sqrt(np.mean([(centre.inv() * rotation).magnitude() ** 2 for rotation in near])))
    print(f"{name}: distance {distance:.3f} degrees, by SciPy {true:.3f}; standard deviation {spread:.3f}, with the"
          f" shorter ways {right:.3f}, by SciPy {by_scipy:.3f}")
    ok &= np.isclose(true, 2.0) and np.isclose(right, by_scipy) and by_scipy < 1.0
    ok &= np.isclose(distance, 358.0 if name == "rolled by 90" else 2.0)
    ok &= np.isclose(spread, by_scipy) if name.startswith("level") else spread > 200.0
q, p = Quaternion(1, 0, 0, 0), Quaternion(1, 0.1, 0, 0)
flipped = Quaternion(*-p.coordinates)
print(f"equal: {p == flipped}; distances {np.degrees(q.distance(p)):.3f} and {np.degrees(q.distance(flipped)):.3f}")
ok &= p == flipped and np.isclose(q.distance(p) + q.distance(flipped), 2.0 * np.pi)
sys.exit(not ok)
PY
