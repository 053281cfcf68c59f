#!/usr/bin/env bash
# CameraTransform 1.2.1: `BrownLensDistortion` has the radial polynomial of OpenCV. It tabulates the polynomial up to a
# radius of 2, which is far outside of most images, and inverts the table. Where the polynomial falls out there, and
# rises again, the table has no inverse. The library catches the error of its interpolation, and takes the identity in
# place of the inverse, everywhere. `imageFromDistorted` then returns the pixel that it gets, and `spaceFromImage` the
# ray of a camera without distortion. Projection distorts as before. Nothing warns.
# An image of 640 by 480 px with f = 600 px ends at a radius of 0.67. With k1 = -0.35, the way there and back misses
# its corner by 58 px for k2 = 0.05, and by less than 0.01 px for k2 = 0.06.
# Law: one direction undoes the other. OpenCV 4.14.0.94 inverts each of these lenses.
# Upstream: no issue of github.com/rgerum/cameratransform that was found describes it.
# Undistort pixels by `cv2.undistortPointsIter`, and give them to a `Camera` without a lens.
# Prints the errors of both libraries in pixels, and on the ground in metres, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'cameratransform==1.2.1' 'numpy==2.4.6' \
  'scipy==1.17.1' 'opencv-python==4.14.0.94'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import cameratransform as ct
import cv2
import numpy as np

K = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
CORNERS = np.array([[0.0, 0.0], [640.0, 0.0], [0.0, 480.0], [640.0, 480.0], [100.0, 400.0]])
LENSES = {  # k1, k2, k3
    "only k1": (-0.2, 0.0, 0.0),
    "two coefficients": (-0.35, 0.06, 0.0),
    "a smaller k2": (-0.35, 0.05, 0.0),
    "three coefficients": (-0.28, 0.07, 0.02),
    "signs that alternate": (0.1, -0.4, 0.1),
}
radius = np.linspace(0.0, np.linalg.norm([320.0, 240.0]) / 600.0, 1000)  # up to the corner
projection = ct.RectilinearProjection(focallength_px=600.0, center=(320.0, 240.0), image=(640, 480))
orientation = ct.SpatialOrientation(elevation_m=2.0, tilt_deg=65.0)
ground = ct.Camera(projection, orientation).spaceFromImage([[20.0, 460.0], [320.0, 400.0], [620.0, 300.0]], Z=0.0)
found = {}
for name, (k1, k2, k3) in LENSES.items():
    rises = np.all(np.diff(radius * (1.0 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6)) > 0.0)
    camera = ct.Camera(projection, orientation, ct.BrownLensDistortion(k1, k2, k3))
    pixels = camera.lens.distortedFromImage(CORNERS)
    back = camera.lens.imageFromDistorted(pixels)
    count = cv2.TERM_CRITERIA_COUNT, 100, 0.0
    by_opencv = cv2.undistortPointsIter(pixels[:, None], K, np.array([k1, k2, 0.0, 0.0, k3]), np.eye(3), K, count)[:, 0]
    points = camera.spaceFromImage(camera.imageFromSpace(ground), Z=0.0)
    differences = back - CORNERS, by_opencv - CORNERS, points - ground
    error, error_opencv, error_m = (np.linalg.norm(difference, axis=1).max() for difference in differences)
    found[name] = error, error_m, np.array_equal(back, pixels)
    print(f"{name} {k1, k2, k3}: {error:.2f} px by CameraTransform, {error_opencv:.2f} px by OpenCV,",
          f"{error_m:.2f} m on the ground", "(returns the pixels that it gets)" if found[name][2] else "")
    if not rises or error_opencv > 0.01:
        sys.exit("a lens that has no inverse in the image")
given_up = [name for name, (error, error_m, unchanged) in found.items() if unchanged and error > 5.0]
others = [values for name, values in found.items() if name not in given_up]
wrong = given_up == ["a smaller k2", "signs that alternate"] and found["a smaller k2"][1] > 0.1
sys.exit(not (wrong and all(error < 0.2 and error_m < 0.01 and not unchanged for error, error_m, unchanged in others)))
PY
