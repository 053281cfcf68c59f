#!/usr/bin/env bash
# fisheye-tools 0.1.1: `FisheyeToPerspective(file, fov, perspective_fov, format=FisheyeFormat.DIAGONAL)` makes a pinhole
# image from one of a diagonal fisheye lens. Its documentation says that such an image "extends to the edges of the
# sensor", and `fov` is its field of view, which the corners of the sensor limit. But the library first crops each image
# to a square, and takes the diagonal of the square for that of the sensor. Nothing warns. So the focal length is too
# short, by 15 % for 4:3 and 31 % for 16:9. Angles from the axis come out too large by 18 and 44 %, and straight lines
# are bent.
# Law: a point at an angle a from the axis belongs at the distance f tan(a) from the centre, and three points of a
# straight line stay on a line. A square image needs no crop, and fulfils both.
# Upstream: no public issue that was found describes it.
# Right is `fov` times the diagonal of the square by that of the sensor, for an equidistant lens.
# Prints angles and the bend of a line for three sensors, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'fisheye-tools==0.1.1' 'numpy==1.26.4' \
  'opencv-python-headless==4.11.0.86'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import cv2
import numpy as np
from fisheye.projection import FisheyeToPerspective
from fisheye.schemas import CameraType, FisheyeFormat

print("fisheye-tools", version("fisheye-tools"))
FIELD, VIEW = 180.0, 90.0  # degrees


def seen(width, height, x, y, field):
    """Where the library draws the point (x, y, 1), in focal lengths of its image."""
    focal = 0.5 * np.hypot(width, height) / np.radians(0.5 * FIELD)  # px per rad, equidistant
    radius = np.hypot(x, y)
    offset = focal * np.arctan(radius) * np.array((x, y)) / radius
    square = min(width, height)  # the centre that the library uses
    centre = np.array(((width - square) // 2, (height - square) // 2)) + (square - 1) // 2
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    dot = np.exp(-0.5 * ((u - centre[0] - offset[0]) ** 2 + (v - centre[1] - offset[1]) ** 2) / 3.0**2)
    cv2.imwrite("image.png", np.repeat(np.round(250.0 * dot).astype("uint8")[..., None], 3, axis=2))
    image = FisheyeToPerspective("image.png", field, VIEW, CameraType.EQUIDISTANT, FisheyeFormat.DIAGONAL)()
    image = image[..., 0].astype(float)
    v, u = np.mgrid[:square, :square] - (square - 1) // 2
    return np.array((np.sum(u * image), np.sum(v * image))) / np.sum(image) / (
        0.5 * np.sqrt(2.0) * square / np.tan(np.radians(0.5 * VIEW)))


ok = True
for width, height in ((480, 480), (640, 480), (854, 480)):
    ratio = np.hypot(width, height) / np.hypot(480, 480)
    for field, stretch in ((FIELD, ratio), (FIELD / ratio, 1.0)):
        angles = [np.degrees(np.arctan(np.hypot(*seen(width, height, np.tan(np.radians(a)), 0.0, field))))
                  for a in (10.0, 20.0)]
        line = np.array([seen(width, height, x, 0.3, field) for x in (-0.3, 0.0, 0.3)])
        bend = line[1, 1] - 0.5 * (line[0, 1] + line[2, 1])
        print(f"{width} x {height}, fov {field:.1f}: angles of 10 and 20 degrees come out as {angles[0]:.2f} and"
              f" {angles[1]:.2f}; the middle of a straight line is off by {480 / np.sqrt(2.0) * bend:.2f} px")
        ok &= np.allclose(angles, stretch * np.array((10.0, 20.0)), rtol=0.01)
        ok &= (abs(bend) > 0.002) == (stretch > 1.1)
sys.exit(not ok)
PY
