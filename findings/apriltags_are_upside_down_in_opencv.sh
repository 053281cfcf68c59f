#!/usr/bin/env bash
# OpenCV 5.0.0.93 and 4.12.0.88 draw and read the AprilTags of the family 36h11 turned by 180 degrees against the
# AprilTag library. pupil-apriltags 1.0.4 finds the picture that OpenCV draws upside down. The tags of moms-apriltag
# 2023.1.15, which come from the family's own definition, are upside down for OpenCV. Both find the same number, so
# nothing tells it: the pose of a tag is turned by 180 degrees about its normal, and a grid of the library's tags fits
# no GridBoard.
# Upstream: the issue github.com/opencv/opencv-python/issues/1195.
# Prints both turns, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'pupil-apriltags==1.0.4.post11'
"${pip[@]}" --no-deps 'moms-apriltag==2023.1.15'
cd "$folder"
cat >turns.py <<'PY'
import sys

import cv2
import numpy as np
from moms_apriltag import TagGenerator2
from pupil_apriltags import Detector

tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
library, opencv = Detector(families="tag36h11"), cv2.aruco.ArucoDetector(tags)
of_opencv = np.pad(cv2.aruco.generateImageMarker(tags, 3, 200), 50, constant_values=255)
of_library = np.kron(np.asarray(TagGenerator2("tag36h11").generate(3)) > 0, np.full((25, 25), 255))
of_library = np.pad(of_library.astype(np.uint8), 50, constant_values=255)
upright = []
for picture in (of_opencv, of_library):
    (found,) = library.detect(picture)
    corners, numbers, _ = opencv.detectMarkers(picture)
    assert found.tag_id == np.ravel(numbers)[0] == 3
    upright.append(bool(found.homography[1, 1] / found.homography[2, 2] > 0.0))  # the library's y is down
    upright.append(bool(corners[0].reshape(4, 2)[0].max() < 100))  # OpenCV begins with the top left
print(f"OpenCV {cv2.__version__}, upright by library and OpenCV:",
      f"OpenCV's tag 3 {upright[:2]}, the library's tag 3 {upright[2:]}")
sys.exit(upright != [False, True, True, False])
PY
for version in 4.12.0.88 5.0.0.93; do
  "${pip[@]}" --no-deps "opencv-python-headless==$version"
  "$folder/venv/bin/python" turns.py
done
