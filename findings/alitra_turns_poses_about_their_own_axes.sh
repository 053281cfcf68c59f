#!/usr/bin/env bash
# alitra 1.1.5: `Transform` takes positions, orientations and poses from one frame to another, as from the map of a
# robot to that of a plant. `transform_pose` and `transform_orientation` multiply the rotation of the frames on the
# right of the orientation, where it belongs on the left. So the body turns about its own axes in place of those of the
# frame. For frames that differ by a heading of 90 degrees, a camera that looks down by 30 degrees comes out level, and
# rolled by 30. What is 10 m ahead of it is 5 m off. Nothing warns. Positions are right, and so are upright bodies for
# such frames.
# Law: a point that a pose sees has one place in the other frame, by the pose and by itself. Were the quaternions meant
# the other way, from the frame to the body, not even headings would be right.
# Upstream: no issue of github.com/equinor/alitra that was found describes it.
# `transform.rotation * orientation.to_rotation()` is right.
# Prints angles and errors for four poses, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'alitra==1.1.5' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from alitra import Frame, Orientation, Pose, Position, Transform, Translation
from scipy.spatial.transform import Rotation

robot, plant = Frame("robot"), Frame("plant")
transform = Transform.from_euler_array(
    Translation(5.0, -3.0, from_=robot, to_=plant, z=1.0), np.array((np.pi / 2, 0.0, 0.0)), robot, plant)
AHEAD = np.array((10.0, 0.0, 0.0))
POSES = {"upright": (40, 0, 0), "down by 30": (0, 30, 0), "rolled by 20": (0, 0, 20), "all": (130, 30, 20)}


def moved(position):
    return transform.transform_position(Position.from_array(position, robot), robot, plant).to_array()


found = {}
for name, angles in POSES.items():
    orientation = Rotation.from_euler("ZYX", angles, degrees=True)
    pose = Pose(Position(1.0, 2.0, 0.5, robot), Orientation.from_rotation(orientation, robot), robot)
    by = transform.transform_pose(pose, robot, plant)
    turned = by.orientation.to_rotation()
    here, there = pose.position.to_array(), by.position.to_array()
    assert np.allclose(there, moved(here))
    off = np.linalg.norm(turned.apply(AHEAD) + there - moved(orientation.apply(AHEAD) + here))
    other = np.linalg.norm(turned.inv().apply(AHEAD) + there - moved(orientation.inv().apply(AHEAD) + here))
    left = (transform.rotation * orientation).apply(AHEAD) + there - moved(orientation.apply(AHEAD) + here)
    after = turned.as_euler("ZYX", degrees=True)
    found[name] = off, other, np.linalg.norm(left), after
    print(f"{name}: heading, pitch and roll {angles}, then ({', '.join(f'{angle + 0.0:.1f}' for angle in after)});",
          f"the point ahead is off by {off:.2f} m, read the other way by {other:.2f} m,",
          f"with the rotation on the left by {found[name][2]:.2f} m")
ok = all(left < 1e-9 and other > 5.0 for _, other, left, _ in found.values())
ok &= found["upright"][0] < 1e-9 and found["down by 30"][0] > 5.0 and found["all"][0] > 1.0
ok &= bool(np.allclose(found["down by 30"][3], (90.0, 0.0, 30.0)))
sys.exit(not ok)
PY
