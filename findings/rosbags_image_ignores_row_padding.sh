#!/usr/bin/env bash
# rosbags-image 0.10.4: `message_to_cvimage` reads the pixels of a sensor_msgs/Image as if its rows were packed. By the
# definition of the message, `step` is the full length of a row in bytes, and drivers pad rows to a multiple of it. The
# padding becomes pixels: each row is shifted by the padding of all rows above, and the last rows are lost. A vertical
# line in an image of 638 pixels, padded to 640, is slanted by two pixels per row. Shape and type are right, and nothing
# warns.
# Law: padding is no part of the image, so the padded and the packed message hold the same one.
# Upstream: the code is at gitlab.com/ternaris/rosbags; no report of it was found.
# Prints the column of the line in some rows, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'rosbags-image==0.10.4' 'rosbags==0.11.9' \
  'opencv-python-headless==5.0.0.93' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE).types
HEADER = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](0, 0), "camera")
HEIGHT, WIDTH, COLUMN = 480, 638, 100
ROWS = [0, 1, 100, 200]


def read(kind, encoding, step):
    """The image that is read from a message whose rows have ``step`` bytes."""
    rows = np.zeros((HEIGHT, step // np.dtype(kind).itemsize), kind)
    rows[:, COLUMN] = 200
    data = rows.view(np.uint8).ravel()
    return message_to_cvimage(TYPES["sensor_msgs/msg/Image"](HEADER, HEIGHT, WIDTH, encoding, 0, step, data))


ok = True
for kind, encoding in (("u1", "mono8"), ("<u2", "16UC1")):
    size = np.dtype(kind).itemsize
    packed, padded = (read(kind, encoding, step * size) for step in (WIDTH, 640))
    columns = [image.argmax(axis=1)[ROWS].tolist() for image in (packed, padded)]
    print(f"{encoding}, line at column {COLUMN}: rows {ROWS} of the packed image have it at {columns[0]},",
          f"of the padded image at {columns[1]}")
    ok &= packed.shape == padded.shape == (HEIGHT, WIDTH) and packed.dtype == padded.dtype
    ok &= columns == [[COLUMN] * 4, [COLUMN + 2 * row for row in ROWS]]
sys.exit(not ok)
PY
