#!/usr/bin/env bash
# trajectopy 5.1.2: `adopt_first_pose` moves a trajectory so that its first pose is that of the reference. "Match First
# Pose" of the library's window, which promises to move and rotate the trajectory, calls it. It shifts positions, and
# does not rotate them. To all orientations it adds the difference of the first Euler angles. So the first pose is
# right, and the others are not. An estimate without any error, in a world that is turned by 120 degrees about the
# vertical, gets an error of 7 m. In a world with the axes of a camera, orientations are wrong by 127 degrees too.
# Law: a motion of the world keeps relative poses. Exact ones that begin at the true pose are the true poses.
# Upstream: no issue of github.com/gereon-t/trajectopy that was found describes it.
# `align` rotates positions and orientations. To match the first pose alone, use `Trajectory.transform`.
# Prints the errors after both, for four worlds, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'trajectopy==5.1.2' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from scipy.spatial.transform import Rotation
from trajectopy import Trajectory, ate
from trajectopy.processing.alignment import adopt_first_pose

t = np.arange(0.0, 20.0, 0.1)
p_W = np.column_stack([4.0 * np.sin(0.5 * t), 3.0 * np.sin(0.7 * t + 1.0), 0.3 * t])
R_WB = Rotation.from_euler("ZYX", np.column_stack([0.5 * t, 0.3 * np.sin(t), 0.2 * np.cos(1.3 * t)]))
true = Trajectory.from_arrays(p_W, quat=R_WB.as_quat(), timestamps=t)


def errors(trajectory, **options):
    """Root mean squares of the errors in metres and degrees."""
    result = ate(trajectory, true, **options)
    return result.pos_dev_rms, np.degrees(result.rot_dev_rms)


WORLDS = {
    "shifted": Rotation.identity(),
    "turned by 120 degrees": Rotation.from_euler("z", 120, degrees=True),
    "pitched by 30 degrees": Rotation.from_euler("y", 30, degrees=True),
    "with axes of a camera": Rotation.from_euler("x", -90, degrees=True),
}
found, right = {}, True
for name, R_VW in WORLDS.items():
    p_V = R_VW.apply(p_W) + [5.0, 6.0, 7.0]
    exact = Trajectory.from_arrays(p_V, quat=(R_VW * R_WB).as_quat(), timestamps=t)
    first = adopt_first_pose(exact, true, inplace=False)
    T = true.se3[0] @ np.linalg.inv(exact.se3[0])
    by_hand = errors(exact.transform(T, inplace=False), align=False)
    aligned, found[name] = errors(exact), errors(first, align=False)
    print(f"{name}: {found[name][0]:.2f} m and {found[name][1]:.1f} degrees after adopt_first_pose;",
          f"{aligned[0]:.2f} m and {aligned[1]:.1f} degrees after align;",
          f"{by_hand[0]:.2f} m and {by_hand[1]:.1f} degrees after transform")
    right &= np.allclose(first.se3[0], true.se3[0]) and max(*aligned, *by_hand) < 1e-6
shifted, turned, pitched, camera = found.values()
wrong = turned[0] > 5.0 and turned[1] < 1e-6 and min(pitched[0], camera[0]) > 1.0 and min(pitched[1], camera[1]) > 20.0
sys.exit(not (right and max(shifted) < 1e-6 and wrong))
PY
