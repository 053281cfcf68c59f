#!/usr/bin/env bash
# pcdkit 0.2.14: it promises to read and write PCD files, "ASCII, binary, and compressed". A compressed file has all
# values of x first, then all of y, and so on. pcdkit reads it so, but writes the points one after the other. Nothing
# warns, as the number of bytes is right. So a point cloud that is saved with format="binary_compressed" comes back as
# another one, whose coordinates are mixed. Other programs that follow the format read the same mixture. The formats
# binary and ascii are right.
# Prints points before and after, and what the bytes of the file hold, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'pcdkit==0.2.14' 'python-neo-lzf==0.3.5' 'numba==0.68.1' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import struct
import sys

import lzf
import numpy as np
from pcdkit import from_array, load_pcd_from_path

points = np.zeros(4, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
points["x"], points["y"], points["z"] = (1, 2, 3, 4), (10, 20, 30, 40), (100, 200, 300, 400)
found = {}
for name in ("ascii", "binary", "binary_compressed"):
    from_array(points).save(f"{name}.pcd", format=name)
    found[name] = load_pcd_from_path(f"{name}.pcd").pc_data
    print(f"{name}: {[tuple(map(float, point)) for point in found[name]]}")
with open("binary_compressed.pcd", "rb") as file:
    head, content = file.read().split(b"DATA binary_compressed\n")
packed, size = struct.unpack("<II", content[:8])
values = np.frombuffer(lzf.decompress(content[8 : 8 + packed], size), "<f4")
by_rows = np.array_equal(values, [value for point in points for value in point])
by_columns = np.array_equal(values, np.concatenate([points[name] for name in points.dtype.names]))
print(f"the compressed bytes hold {values.tolist()}; by columns, as the format asks for: {by_columns}")
ok = all(np.array_equal(found[name], points) for name in ("ascii", "binary"))
sys.exit(not (ok and by_rows and not by_columns and not np.array_equal(found["binary_compressed"], points)))
PY
