#!/usr/bin/env bash
# Open3D 0.19.0: one intrinsic matrix means two cameras. `RaycastingScene.create_rays_pinhole` sends the ray of pixel
# (0, 0) through (0.5, 0.5), so pixel centres are at halves. `PointCloud.create_from_depth_image` takes the same pixel
# at (0, 0). A depth image that one renders of a plane becomes, by the other and with the same matrix, points beside the
# plane: by half a pixel, which is 5 mm at 1 m for a focal length of 100 px. The documentation of neither tells its
# convention. Half a pixel taken off the principal point for the points makes them meet.
# Prints the distances to the plane, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'open3d-cpu==0.19.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
import open3d
from open3d.t.geometry import Image, PointCloud, RaycastingScene

WIDTH, HEIGHT, FOCAL = 160, 120, 100.0
slanted = np.array([[-9, -9, -8], [9, -9, 10], [9, 9, 10], [-9, 9, -8]], np.float32)  # z = 1 + x
scene = RaycastingScene()
scene.add_triangles(open3d.core.Tensor(slanted), open3d.core.Tensor(np.array([[0, 1, 2], [0, 2, 3]], np.uint32)))


def matrix(shift):
    u, v = 0.5 * WIDTH + shift, 0.5 * HEIGHT + shift
    return open3d.core.Tensor(np.array([[FOCAL, 0.0, u], [0.0, FOCAL, v], [0.0, 0.0, 1.0]]))


rays = scene.create_rays_pinhole(matrix(0.0), open3d.core.Tensor(np.eye(4)), WIDTH, HEIGHT)
first = rays[0, 0, 3:].numpy()
pixel = FOCAL * first[:2] / first[2] + (0.5 * WIDTH, 0.5 * HEIGHT)
depth = Image(scene.cast_rays(rays)["t_hit"])  # the rays have z = 1, so their length is the depth
errors = []
for shift in (0.0, -0.5):
    cloud = PointCloud.create_from_depth_image(depth, matrix(shift), depth_scale=1.0, depth_max=2.0)
    points = cloud.point.positions.numpy()
    errors.append(float(np.abs(points[:, 2] - points[:, 0] - 1.0).max()))
print(f"the ray of pixel (0, 0) passes ({pixel[0]:.2f}, {pixel[1]:.2f}); points off the plane by up to",
      f"{1e3 * errors[0]:.2f} mm, with half a pixel off the principal point {1e3 * errors[1]:.4f} mm")
sys.exit(not (np.allclose(pixel, 0.5, atol=1e-3) and errors[0] > 5e-3 and errors[1] < 1e-4))
PY
