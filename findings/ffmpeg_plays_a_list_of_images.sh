#!/usr/bin/env bash
# OpenCV 5.0.0.93 and PyAV 18.1.0 open a text file that lists images, as TUM's rgb.txt does, as a video: FFmpeg draws the
# letters of the text, as a terminal would. Who gives the list in place of the folder gets images of text, without an error.
# PyAV tells the container's name, tty; OpenCV tells nothing.
# Prints how many images both find, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'opencv-python-headless==5.0.0.93' 'av==18.1.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import av
import cv2

with open("rgb.txt", "w") as file:
    file.write("# timestamp filename\n")
    file.writelines(f"{100.0 + k / 30.0:.6f} rgb/{k:04}.png\n" for k in range(300))
capture, count = cv2.VideoCapture("rgb.txt"), 0
while capture.read()[0]:
    count += 1
with av.open("rgb.txt") as container:
    name, images = container.format.name, sum(1 for _ in container.decode(video=0))
print(f"OpenCV: {count} images; PyAV: {images} images, of the container {name}")
sys.exit(not (count > 0 and images > 0 and name == "tty"))
PY
