#!/usr/bin/env bash
# rigid-body-motion 0.9.3 (numpy-quaternion 2024.0.13), which describes itself as a re-implementation of ROS's tf2,
# interpolates the rotations of a moving frame between its stamps. A quaternion and its negative are one rotation. The
# library interpolates their numbers, so where the sign changes from one stamp to the next, it swings away from both.
# Sources with a sign rule, as SciPy's `as_quat(canonical=True)`, change it where a heading passes 180 degrees. There,
# the frame of a robot that turns steadily is up to 26 degrees off, and a point 10 m ahead by more than 4 m.
# Law: the signs of the quaternions must not matter; tf2 takes the shorter way.
# `squad` of numpy-quaternion does the work. Its documentation excludes changes of sign. That of rigid-body-motion
# excludes nothing.
# Upstream: no issue of github.com/phausamann/rigid-body-motion that was found describes it.
# Apply `quaternion.unflip_rotors` to the rotations before `register_frame`.
# Prints errors of both, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'rigid-body-motion==0.9.3' \
  'numpy-quaternion==2024.0.13' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
import quaternion
import rigid_body_motion as rbm
from scipy.spatial.transform import Rotation

RATE, AHEAD = np.radians(36.0), np.array([10.0, 0.0, 0.0])
stamps, times = np.arange(0.0, 10.1, 0.5), np.arange(0.0, 10.01, 0.05)
canonical = Rotation.from_euler("z", RATE * stamps[:, None]).as_quat(canonical=True)[:, [3, 0, 1, 2]]
unflipped = quaternion.as_float_array(quaternion.unflip_rotors(quaternion.from_float_array(canonical)))
same = np.allclose(np.abs(np.sum(canonical * unflipped, axis=1)), 1.0)

rbm.register_frame("world")
points = Rotation.from_euler("z", RATE * times[:, None]).apply(AHEAD)
found = {}
for name, rotation in (("with changes of sign", canonical), ("without", unflipped)):
    rbm.register_frame("robot", "world", np.zeros((len(stamps), 3)), rotation, stamps, update=True)
    p_W, at = rbm.transform_points(np.tile(AHEAD, (len(times), 1)), into="world", outof="robot", timestamps=times,
                                   return_timestamps=True)
    assert np.array_equal(at, times)
    off = np.degrees(np.arccos(np.clip(np.sum(p_W * points, axis=1) / 100.0, -1.0, 1.0)))
    k = off.argmax()
    found[name] = off.max(), np.linalg.norm(p_W - points, axis=1).max(), np.degrees(RATE * times[k])
    print(f"{name}: off by up to {found[name][0]:.2f} degrees, and {found[name][1]:.2f} m at 10 m;",
          f"the largest at a heading of {found[name][2]:.0f} degrees")
flipped, smooth = found.values()
sys.exit(not (same and smooth[0] < 1e-3 and flipped[0] > 20.0 and flipped[1] > 4.0 and 150.0 < flipped[2] < 220.0))
PY
