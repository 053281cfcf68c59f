#!/usr/bin/env bash
# pyfisheye 1.0.1: a `Camera` has a polynomial and a stretch matrix, which a calibration finds too. `cam2world` applies
# the matrix to a pixel, and `world2cam` its inverse to a projection. `world2cam_fast`, documented as the same
# projection by a table, applies the matrix itself. So it stretches twice as far to the other side. Nothing warns. For a
# matrix with 1.002 and 0.0005 in its first row, an image of 1280 by 960 px is off by up to 6 px, and for pixels that
# are stretched by 1 %, by up to 25. `reproject_perspective` and `map_perspective` call it.
# With the identity, the default, it agrees with `world2cam` within 0.0001 px.
# Law: a point projects to the pixel whose ray it lies on.
# Upstream: the package names no repository; no report of it was found.
# `world2cam` is right. To use the fast one, give a camera without the matrix, and apply the inverse to its pixels.
# Prints the errors of both projections, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'opencv-python-headless==5.0.0.93' 'tqdm==4.70.1' 'ndshapecheck==0.2.4' \
  'rich==15.0.0'
"${pip[@]}" --no-deps 'pyfisheye==1.0.1' # it asks for OpenCV with windows
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pyfisheye.camera import Camera

CENTRE, SIZE = np.array((640.0, 480.0)), np.array((1280, 960))
POLYNOMIAL = np.array((400.0, 0.0, -6e-4, 2e-7, -3e-10))  # lowest power first
STRETCHES = {
    "none": ((1.0, 0.0), (0.0, 1.0)),
    "as of a calibration": ((1.002, 0.0005), (0.0003, 1.0)),
    "wide pixels": ((1.01, 0.0), (0.0, 1.0)),
}
pixels = np.array([(u, v) for u in (50.0, 350.0, 700.0, 1230.0) for v in (40.0, 400.0, 900.0)])
found = {}
for name, stretch in STRETCHES.items():
    stretch = np.array(stretch)
    camera = Camera(CENTRE, POLYNOMIAL, stretch, SIZE)
    rays = camera.cam2world(pixels)
    plain = Camera(CENTRE, POLYNOMIAL, np.eye(2), SIZE).world2cam_fast(rays)
    ways = {
        "world2cam": camera.world2cam(rays),
        "world2cam_fast": camera.world2cam_fast(rays),
        "fast with the inverse": plain @ np.linalg.inv(stretch).T,
        "fast with the matrix": plain @ stretch.T,
    }
    found[name] = {way: np.linalg.norm(got - pixels, axis=-1) for way, got in ways.items()}
    same = np.abs(ways["world2cam_fast"] - ways["fast with the matrix"]).max()
    print(f"stretch {name}:",
          *(f"{way} off by {off.min():.1e} to {off.max():.1e} px;" for way, off in found[name].items()),
          f"the last is world2cam_fast within {same:.0e} px")
    if same > 1e-9 or max(found[name][way].max() for way in ("world2cam", "fast with the inverse")) > 1e-3:
        sys.exit("the projection has changed")
worst = {name: off["world2cam_fast"].max() for name, off in found.items()}
sys.exit(not (worst["none"] < 1e-3 and 4.0 < worst["as of a calibration"] < 7.0 and 20.0 < worst["wide pixels"] < 30.0))
PY
