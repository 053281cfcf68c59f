#!/usr/bin/env bash
# easypcd 0.0.33: `ep().write_txt(name, points)` is documented to save a point cloud as text. It converts each number
# to an integer first, towards zero. Nothing warns. So a cloud in metres loses all that is smaller than a metre: a
# room of 4 m by 3 m is left with a few points. `write_pcd` of the same class keeps nine digits.
# Prints how many points are left and how far they have moved, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'easypcd==0.0.33' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from easypcd.easypcd import ep

points = np.random.default_rng(0).uniform((-2.0, -1.5, 0.0), (2.0, 1.5, 2.4), (1000, 3))  # metres
ep().write_txt("cloud.txt", points)
ep().write_pcd("cloud.pcd", points)
found = {}
for name, rows in (("text", 0), ("PCD", 11)):
    read = np.loadtxt("cloud.txt" if name == "text" else "cloud.pcd", skiprows=rows)
    moved = np.linalg.norm(read - points, axis=1)
    found[name] = len(np.unique(read, axis=0)), float(moved.mean())
    print(f"{name}: {found[name][0]} different points of {len(points)}, moved by {found[name][1]:.6f} m on average")
cut = np.array_equal(np.loadtxt("cloud.txt"), np.trunc(points))
ok = cut and found["PCD"][0] == len(points) and found["PCD"][1] < 1e-7
sys.exit(not (ok and found["text"][0] < 50 and found["text"][1] > 0.5))
PY
