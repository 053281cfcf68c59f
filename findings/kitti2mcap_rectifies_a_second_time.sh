#!/usr/bin/env bash
# kitti2mcap 0.1.1: it writes KITTI's rectified images and a `CameraInfo` for each, whose `k` is the matrix of the
# rectified camera and whose `d` is zero. So they describe the image as it is. `r` is KITTI's rotation from the
# unrectified camera. In ROS, k, d and r belong to the image of the message, and p to the image after rectification.
# A subscriber that rectifies by them turns the rectified image once more: with a rotation of 1.2 degrees, pixels move
# by up to 14. Nothing warns. The topic is named `image_raw`, which ROS rectifies.
# In calibration.py, `camera_info_msg` takes `R_rect_00` for r, where the rotation is already in the image. The page of
# the package names both, the rectified images and `R_rect`.
# Law: p r k^-1 leaves pixels of a rectified image where they are. A point of the lidar, brought to the camera's frame
# by the written transforms and projected by p, lies at KITTI's pixel.
# Upstream: no issue of github.com/AdityaSrinivasManohar/kitti2mcap that was found describes it.
# The identity, as `r`, is right.
# Prints how pixels move, for two rotations, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'kitti2mcap==0.1.1' 'pykitti==0.3.1' \
  'mcap==1.6.0' 'mcap-ros2-support==0.6.0' 'numpy==2.4.6' 'pillow==13.0.0' 'pandas==3.1.1' \
  'opencv-python-headless==5.0.0.93'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import contextlib
import io
import sys
from pathlib import Path

import numpy as np
from kitti2mcap.cli import main
from mcap_ros2.reader import read_ros2_messages
from PIL import Image

WIDTH, HEIGHT, DATE = 1242, 375, "2011_09_26"
K = np.array(((720.0, 0.0, 610.0), (0.0, 720.0, 175.0), (0.0, 0.0, 1.0)))
P = np.column_stack((K, np.zeros(3)))
VELO_FROM_IMU, CAMERA_FROM_VELO = np.eye(4), np.array(((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)))
VELO_FROM_IMU[:3, 3] = -0.8, 0.3, -0.8


def turn(roll):
    """Rotation about the optical axis by ``roll`` degrees."""
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def text(values):
    return " ".join(f"{value:.12e}" for value in np.ravel(values))


def drive(root, R_rect):
    """Write a drive of one frame, whose camera 0 is rectified by ``R_rect``."""
    sync = root / DATE / f"{DATE}_drive_0001_sync"
    for name in ("image_00", "velodyne_points", "oxts"):
        (sync / name / "data").mkdir(parents=True)
        (sync / name / "timestamps.txt").write_text("2011-09-26 13:02:25.964389445\n")
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint8)).save(sync / "image_00" / "data" / "0000000000.png")
    np.zeros((4, 4), np.float32).tofile(sync / "velodyne_points" / "data" / "0000000000.bin")
    (root / DATE / "calib_imu_to_velo.txt").write_text(f"R: {text(np.eye(3))}\nT: {text(VELO_FROM_IMU[:3, 3])}\n")
    (root / DATE / "calib_velo_to_cam.txt").write_text(f"R: {text(CAMERA_FROM_VELO)}\nT: {text((0.0, -0.1, -0.3))}\n")
    (root / DATE / "calib_cam_to_cam.txt").write_text("".join(
        f"R_rect_0{i}: {text(R_rect if i == 0 else np.eye(3))}\nP_rect_0{i}: {text(P)}\n" for i in range(4)))


def pixels(homogeneous):
    return homogeneous[:2] / homogeneous[2]


def matrix(transform):
    (x, y, z, w), t = ([getattr(transform.rotation, name) for name in "xyzw"], transform.translation)
    T = np.eye(4)
    T[:3, :3] = ((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                 (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                 (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))
    T[:3, 3] = t.x, t.y, t.z
    return T


ok = True
u, v = np.meshgrid(np.linspace(0.0, WIDTH - 1.0, 9), np.linspace(0.0, HEIGHT - 1.0, 5))
corners = np.stack((u.ravel(), v.ravel(), np.ones(u.size)))
for roll in (0.0, 1.2):
    root = Path(f"roll{roll}")
    drive(root, turn(roll))
    with contextlib.redirect_stdout(io.StringIO()):
        options = "--date", DATE, "--drive", "0001", "--cameras", "0", "--no-imu"
        assert main([*options, "--kitti-dir", str(root), "--output", f"{roll}.mcap"]) == 0
    found = {message.channel.topic: message.ros_msg for message in read_ros2_messages(f"{roll}.mcap")}
    info = found["/kitti/camera_gray_left/camera_info"]
    k, r, p = np.reshape(info.k, (3, 3)), np.reshape(info.r, (3, 3)), np.reshape(info.p, (3, 4))
    moved = pixels(p[:, :3] @ r @ np.linalg.inv(k) @ corners) - corners[:2]
    unmoved = pixels(p[:, :3] @ np.linalg.inv(k) @ corners) - corners[:2]
    tree = {t.child_frame_id: matrix(t.transform) for t in found["/tf_static"].transforms}
    point = np.array((20.0, 6.0, -1.0, 1.0))
    rectified = turn(roll) @ (CAMERA_FROM_VELO @ point[:3] + (0.0, -0.1, -0.3))
    by_kitti = pixels(P @ np.append(rectified, 1.0))
    in_camera = np.linalg.inv(tree["camera_gray_left"]) @ tree["velodyne"] @ point
    projected = pixels(p[:, :3] @ in_camera[:3])
    again = pixels(p[:, :3] @ r @ np.linalg.inv(k) @ np.append(by_kitti, 1.0))
    off = np.linalg.norm(projected - by_kitti)
    print(f"rotation of {roll} degrees: pixels move by up to {np.linalg.norm(moved, axis=0).max():.2f}, without r by"
          f" {np.abs(unmoved).max():.2f}; a point of the lidar is {off:.2f} pixels off,"
          f" and after rectification {np.linalg.norm(projected - again):.2f}")
    ok &= not any(info.d) and np.allclose(k, P[:, :3]) and np.allclose(p, P) and np.allclose(r, turn(roll))
    ok &= np.abs(unmoved).max() < 1e-6 and off < 1e-3
    ok &= np.abs(moved).max() < 1e-6 if roll == 0.0 else np.linalg.norm(moved, axis=0).max() > 10.0
sys.exit(not ok)
PY
