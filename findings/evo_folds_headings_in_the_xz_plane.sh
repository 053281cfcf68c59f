#!/usr/bin/env bash
# evo 1.38.1: `project(Plane.XZ)`, or `--project_to_plane xz`, folds headings. Of each orientation it keeps one angle of
# the Euler sequence xyz. For the plane XZ that is the middle angle, which ends at 90 degrees. XZ is the ground plane of
# cameras, as in KITTI: there, a heading of 120 degrees becomes 60, and a turn to the left becomes one to the right. A
# path that lies in the plane must stay as it is. Here its relative errors grow from 0.5 to 3.9 degrees, and from 4 to
# 21 cm. The planes XY and YZ keep headings.
# Upstream: no issue of github.com/MichaelGrupp/evo that was found describes it.
# Prints headings and errors before and after, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1'
"${pip[@]}" --no-deps 'evo==1.38.1' # the rest is for its commands
cd "$folder"
HOME="$folder" "$folder/venv/bin/python" - <<'PY'
import copy
import sys

import numpy as np
from evo.core.metrics import RPE, PoseRelation, StatisticsType, Unit
from evo.core.trajectory import Plane, PoseTrajectory3D
from scipy.spatial.transform import Rotation

NORMAL = {Plane.XY: 2, Plane.XZ: 1, Plane.YZ: 0}


def circle(plane, drift):
    """A round in ``plane`` of radius 5 m, heading along the path; it turns by the share ``drift`` too far."""
    angle = np.radians(np.arange(0.0, 360.0, 10.0)) * (1.0 + drift)
    turns = np.zeros((len(angle), 3))
    turns[:, NORMAL[plane]] = angle
    orientations = Rotation.from_rotvec(turns)
    side = np.roll((5.0, 0.0, 0.0), NORMAL[plane] + 1)  # in the plane
    return PoseTrajectory3D(orientations.apply(side) - side, orientations.as_quat()[:, [3, 0, 1, 2]], np.arange(36.0))


found = {}
for plane in NORMAL:
    paths = circle(plane, 0.0), circle(plane, 0.05)
    projected = copy.deepcopy(paths)
    for path in projected:
        path.project(plane)
    row = []
    for reference, estimate in (paths, projected):
        rotvec = Rotation.from_quat(reference.orientations_quat_wxyz[12], scalar_first=True).as_rotvec(degrees=True)
        row.append(round(float(rotvec[NORMAL[plane]]), 6))
        for relation in PoseRelation.rotation_angle_deg, PoseRelation.translation_part:
            metric = RPE(relation, 1, Unit.frames)
            metric.process_data((reference, estimate))
            row.append(round(metric.get_statistic(StatisticsType.rmse), 4))
    moved = max(np.abs(a.positions_xyz - b.positions_xyz).max() for a, b in zip(paths, projected))
    print(f"{plane.name}: heading {row[0]:g} degrees, projected {row[3]:g}; relative errors {row[1]:g} degrees and",
          f"{row[2]:g} m, projected {row[4]:g} degrees and {row[5]:g} m; positions moved by {moved:.0e} m")
    found[plane] = moved < 1e-9, row
ok = all(still and row[0] == 120.0 and row[1] == 0.5 for still, row in found.values())
ok &= all(row[:3] == row[3:] for plane, (_, row) in found.items() if plane is not Plane.XZ)
xz = found[Plane.XZ][1]
sys.exit(not (ok and xz[3] == 60.0 and xz[4] > 3.0 and xz[5] > 4.0 * xz[2]))
PY
