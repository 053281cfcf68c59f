#!/usr/bin/env bash
# evo 1.38.1: `PosePath3D.transform(t)` takes "a 4x4 transformation matrix (e.g. SE(3) or Sim(3))". For a similarity, it
# moves positions rightly, and leaves the scale in the rotations of `poses_se3`. Metrics work on these matrices. Nothing
# warns. So errors of two paths with equal positions and equal quaternions are not zero: the rotation part of the
# absolute error is that of the scale, and even translations of the relative error, in metres, are wrong: with scale 2
# by whole steps, with scale 0.5 by half of them. The path's own `check()` says that it is invalid; no metric calls it.
# Law: equal paths have errors of zero. A path made anew of the same positions and quaternions has. `align` with
# `correct_scale=True`, by which evo itself applies similarities, has too. Scale 1 is right.
# Prints errors of a moved path against the truth, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'evo==1.38.1' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from evo.core import lie_algebra, metrics
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

R = Rotation.from_rotvec((0.3, 0.2, 0.1))
angles = 0.2 * np.arange(20.0)
positions = np.array((np.sin(angles), np.cos(angles), 0.1 * angles)).T
rotations = Rotation.from_rotvec(np.outer(angles, (0.1, 0.2, 0.9)))


def errors(truth, found):
    """Largest absolute rotation part, and largest relative translation part in metres."""
    parts = metrics.PoseRelation
    both = metrics.APE(parts.rotation_part), metrics.RPE(parts.translation_part)
    return np.array([metric.process_data((truth, found)) or metric.error.max() for metric in both])


ok = True
for scale in (1.0, 2.0, 0.5):
    truth, moved, aligned = (PosePath3D(positions_xyz=points, orientations_quat_wxyz=turns.as_quat()[:, [3, 0, 1, 2]])
                             for points, turns in ((scale * R.apply(positions) + 5.0, R * rotations),
                                                   (positions.copy(), rotations), (positions.copy(), rotations)))
    moved.transform(lie_algebra.sim3(R.as_matrix(), np.full(3, 5.0), scale))
    aligned.align(truth, correct_scale=True)
    anew = PosePath3D(positions_xyz=moved.positions_xyz, orientations_quat_wxyz=moved.orientations_quat_wxyz)
    found = {name: errors(truth, other) for name, other in (("moved", moved), ("anew", anew), ("aligned", aligned))}
    steps, valid = np.linalg.norm(np.diff(truth.positions_xyz, axis=0), axis=1).max(), moved.check()[0]
    print(f"scale {scale:g}, steps {steps:.3f} m: rotation part {found['moved'][0]:.3f}, relative translation"
          f" {found['moved'][1]:.3f} m; anew {found['anew'].max():.0e}, aligned {found['aligned'].max():.0e}; {valid}")
    ok &= bool(np.allclose(moved.positions_xyz, truth.positions_xyz))
    ok &= max(found["anew"].max(), found["aligned"].max()) < 1e-6
    ok &= valid == (scale == 1.0) == (found["moved"][0] < 1e-6)
    ok &= bool(np.isclose(found["moved"][1], abs(scale - 1.0) * steps))
sys.exit(not ok)
PY
