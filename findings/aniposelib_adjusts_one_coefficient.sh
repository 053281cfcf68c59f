#!/usr/bin/env bash
# aniposelib 0.8.0: `CameraGroup.bundle_adjust` refines given cameras, as of a calibration by OpenCV with two focal
# lengths and five coefficients. It has one focal length and k1. Before the first iteration, fy becomes fx, and k2, both
# tangential coefficients and k3 become zero, even where the given cameras are exact. The other parameters move to make
# up for it: a focal length of 600 px becomes 636, and the residual of 0.08 px looks good. Nothing warns.
# `only_extrinsics=True` keeps all of them.
# Law: for exact pixels, exact cameras are the optimum; an adjustment that begins there stays there.
# Upstream: no issue of github.com/lambdaloop/aniposelib that was found describes it.
# Prints the cameras before and after, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'opencv-contrib-python-headless==5.0.0.93' 'numba==0.68.1' 'pandas==2.3.3' \
  'toml==0.10.2' 'tqdm==4.70.1' 'jax==0.10.2'
"${pip[@]}" --no-deps 'aniposelib==0.8.0' # it asks for OpenCV with windows
cd "$folder"
cat >exact.py <<'PY'
import sys

import numpy as np
from aniposelib.cameras import Camera, CameraGroup

POINTS = np.random.default_rng(0).uniform((-1.6, -1.2, -1.0), (1.6, 1.2, 1.0), (300, 3))
POSES = [((0.0, 0.0, 0.0), (0.0, 0.0, 4.0)), ((0.0, 0.3, 0.0), (0.5, 0.0, 4.0)), ((0.0, -0.3, 0.0), (-0.5, 0.0, 4.0))]
LENSES = {  # fx, fy, distortion
    "k1 alone": (600.0, 600.0, (-0.3, 0.0, 0.0, 0.0, 0.0)),
    "five coefficients": (600.0, 610.0, (-0.3, 0.12, 0.002, -0.001, 0.0)),
}


def adjusted(fx, fy, distortion, **options):
    """The first camera after a bundle adjustment of exact pixels that begins at the exact cameras."""
    matrix = np.array([[fx, 0.0, 320.0], [0.0, fy, 240.0], [0.0, 0.0, 1.0]])
    cameras = [
        Camera(matrix=matrix.copy(), dist=np.array(distortion), size=(640, 480), rvec=np.array(r), tvec=np.array(t))
        for r, t in POSES
    ]
    group = CameraGroup(cameras)
    pixels = group.project(POINTS).reshape(len(POSES), -1, 2)
    group.bundle_adjust(pixels, verbose=False, **options)
    residual = group.reprojection_error(group.triangulate(pixels), pixels)
    camera = group.cameras[0]
    return np.diag(camera.get_camera_matrix())[:2], camera.get_distortions(), np.sqrt(np.mean(residual**2))


found = []
for name, (fx, fy, distortion) in LENSES.items():
    for options in ({}, {"only_extrinsics": True}):
        focal, coefficients, residual = adjusted(fx, fy, distortion, **options)
        print(f"{name} {options or ''}: focal lengths ({fx}, {fy}) become {focal.round(2)}, {distortion} become",
              f"{coefficients.round(4)}; residual {residual:.4f} px")
        found.append((np.abs(focal - (fx, fy)).max(), coefficients))
(plain, _), (plain_kept, _), (refined, few), (kept, all_five) = found
right = plain < 0.01 and plain_kept == kept == 0.0 and np.allclose(all_five, distortion)
sys.exit(not (right and refined > 20.0 and np.all(few[1:] == 0.0)))
PY
"$folder/venv/bin/python" -W ignore exact.py
