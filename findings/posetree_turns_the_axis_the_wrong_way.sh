#!/usr/bin/env bash
# posetree 1.1.2: `rotate_about_axis`, `rotate_about_x`, `rotate_about_y` and `rotate_about_z` of a `Pose` take the
# frame that the axis is expressed in. To bring the axis from there to the frame of the pose, the library applies the
# rotation of the way back. So the axis is turned to the wrong side, by the same angle. Nothing warns. For a pose in the
# frame of a robot that heads 30 degrees, a turn about the map's x axis is one about an axis 60 degrees from it. For a
# heading of 90 degrees, it is the opposite turn: what should look up looks down.
# `translate` takes a frame too, and is right. So is a turn about an axis that the two frames share, as about the map's
# z axis where the robot stands on flat ground.
# Law: the frame that a pose is expressed in must not matter; the same pose in the frame of the map turns right. SciPy
# 1.17.1 composes the same orientation.
# Upstream: no issue of github.com/robobenjie/posetree that was found describes it.
# `pose.in_frame(frame).rotate_about_axis(axis, angle, frame=frame).in_frame(pose.frame)` is right.
# Prints the errors of turns by 20 degrees for some headings of the robot, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'posetree==1.1.2' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from posetree import CustomFramePoseTree, Pose
from scipy.spatial.transform import Rotation

ANGLE = np.radians(20.0)
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class Tree(CustomFramePoseTree):
    """Has the frames that are added alone."""

    def _get_transform(self, parent_frame, child_frame, timestamp=None):
        raise KeyError(child_frame)


ok = True
for heading in (0.0, 30.0, 90.0, 180.0):
    tree = Tree()
    robot = Rotation.from_euler("z", heading, degrees=True)
    tree.add_frame(Pose.from_position_and_rotation((3.0, 1.0, 0.0), robot, "map", tree), "robot")
    tilt = Rotation.from_euler("y", 10.0, degrees=True)
    camera = Pose.from_position_and_rotation((0.2, 0.0, 1.0), tilt, "robot", tree)
    for name, axis in AXES.items():
        true = Rotation.from_rotvec(ANGLE * np.array(axis)) * camera.in_frame("map").rotation
        turned = getattr(camera, f"rotate_about_{name}")(ANGLE, frame="map").in_frame("map").rotation
        by_map = camera.in_frame("map").rotate_about_axis(axis, ANGLE, frame="map").rotation
        moved = camera.translate(axis, frame="map").in_frame("map").position - camera.in_frame("map").position
        about = (turned * camera.in_frame("map").rotation.inv()).as_rotvec() / ANGLE
        off = np.degrees(np.arccos(np.clip(about @ axis, -1.0, 1.0)))
        error, right = (np.degrees((true.inv() * r).magnitude()) for r in (turned, by_map))
        print(f"robot's heading {heading:g} degrees, the map's {name} axis: turned about {about.round(3) + 0.0},"
              f" {off:.1f} degrees from it, an error of {error:.1f} degrees; in the frame of the map {right:.1f}")
        between = 0.0 if name == "z" else min(2.0 * heading, 360.0 - 2.0 * heading)
        ok &= bool(np.allclose(about, robot.apply(robot.apply(axis)), atol=1e-9))
        ok &= abs(off - between) < 1e-4 and right < 1e-5 and bool(np.allclose(moved, axis))
        if name != "z" and heading == 90.0:
            ok &= abs(error - 40.0) < 1e-5
sys.exit(not ok)
PY
