#!/usr/bin/env bash
# CloudAnalyzer 0.6.0: `ca.trajectory.evaluate_trajectory` promises "SE(3) RPE", relative pose errors, and over
# distances those in "KITTI-style". A relative pose is a motion in the axes of the body. For its translation, the
# library subtracts the steps of both paths in the axes of the world, though it has the orientations. Nothing warns. So
# an error of the heading counts in all steps after it. A path of 200 steps turns by 10 degrees too much at one pose,
# and is exact before and after. Half of its steps have an error, of 17 cm per metre, in place of none. An exact path in
# a frame that is turned by 30 degrees has errors of 52 cm per metre.
# Law: relative errors do not depend on the frame of the estimate, and those of exact steps are zero. evo 1.38.1 obeys
# it.
# Upstream: no issue of github.com/rsasaki0109/CloudAnalyzer that was found describes it.
# The rotational part is right. `align_rigid=True` turns the whole path, which helps in the second case alone.
# Prints the errors of both libraries, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'open3d-cpu==0.19.0' 'numpy==2.4.6' 'scipy==1.17.1' 'laspy==2.7.0' 'PyYAML==6.0.4'
"${pip[@]}" --no-deps 'cloudanalyzer==0.6.0' 'evo==1.38.1' # the rest is for their commands
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from ca.trajectory import evaluate_trajectory
from evo.core.metrics import RPE, PoseRelation
from evo.core.trajectory import PoseTrajectory3D
from scipy.spatial.transform import Rotation

COUNT = 201
times = 0.1 * np.arange(COUNT)
turns = np.radians(3.0 * np.sin(0.05 * np.arange(COUNT - 1)))  # after each step of 1 m


def path(extra=0.0, start=0.0):
    """Poses of a robot that turns by ``extra`` degrees too much once, in a frame turned by ``start`` degrees."""
    turned = turns.copy()
    turned[COUNT // 2 - 1] += np.radians(extra)
    headings = np.radians(start) + np.concatenate(((0.0,), np.cumsum(turned)))
    steps = np.column_stack((np.cos(headings), np.sin(headings), 0.0 * headings))[:-1]
    positions = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    return positions, Rotation.from_euler("z", headings[:, None]).as_quat()


def write(name, positions, quaternions):
    np.savetxt(name, np.column_stack((times, positions, quaternions)), fmt="%.12f")
    return PoseTrajectory3D(positions, np.roll(quaternions, 1, axis=1), times)


true = write("true.txt", *path())
ok = True
for name, options in (("exact", {}), ("one turn by 10 degrees", {"extra": 10.0}), ("other frame", {"start": 30.0})):
    estimate = write("estimate.txt", *path(**options))
    for align in (False, True):
        found = evaluate_trajectory("estimate.txt", "true.txt", align_rigid=align, rpe_distances_m=(10.0,))
        seen = np.array(found["error_series"]["rpe_translation"])
        rotation = np.radians(found["error_series"]["rpe_rotation"])
        metrics = []
        for relation in (PoseRelation.translation_part, PoseRelation.rotation_angle_rad):
            metric = RPE(relation)
            metric.process_data((true, estimate))
            metrics.append(metric.error)
        ten = found["rpe_distance"][0]["translation_percent"]["mean"]
        wrong = [(error > 1e-3).sum() for error in (seen, metrics[0])]
        print(f"{name}, {'aligned' if align else 'not aligned'}: errors in {wrong[0]} of {COUNT - 1} steps, of"
              f" {seen.mean() * 100.0:.1f} cm in the mean, {ten:.1f} % over 10 m; by evo in {wrong[1]} steps")
        ok &= wrong[1] == 0 and np.allclose(rotation, metrics[1], rtol=0.0, atol=1e-5)
        ok &= (rotation > 1e-3).sum() == (1 if "extra" in options else 0)
        due = {"exact": (0, 0), "one turn by 10 degrees": (COUNT // 2, COUNT - 1), "other frame": (COUNT - 1, 0)}
        ok &= wrong[0] == due[name][align]
sys.exit(not ok)
PY
