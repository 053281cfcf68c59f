#!/usr/bin/env bash
# pypcd4 1.5.1: in a PCD file, `rgb` is a float whose bits hold three bytes of colour, as `encode_rgb` makes it. Each of
# these floats is below 2.4e-38. `save(..., encoding=Encoding.ASCII)` writes ten digits after the point of every float,
# so all colours become 0.0000000000, which is black. Nothing warns. Other small numbers lose digits the same way: of a
# variance of 1.234567e-8 m^2 three are left.
# Law: the format's encodings hold the same values. Binary and compressed files of the same cloud keep all colours, and
# so does a text file with nine significant digits, read by the library itself.
# Upstream: no issue of github.com/MapIV/pypcd4 that was found tells it; github.com/dimatura/pypcd/issues/17 tells it of
# the library that it follows, and the closed issue github.com/isl-org/Open3D/issues/5860 of Open3D.
# `Encoding.BINARY`, the default, is right.
# Prints the colours that are read back from all encodings, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pypcd4==1.5.1' 'numpy==2.4.6' 'pydantic==2.14.4' \
  'python-neo-lzf==0.3.5'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pypcd4 import Encoding, PointCloud

COLOURS = np.array(((255, 0, 0), (0, 255, 0), (12, 34, 56), (255, 255, 255)), dtype=np.uint8)
VARIANCES = np.array((1.234567e-8, 2.5e-7, 4e-12, 1.0), dtype=np.float32)
places = np.random.default_rng(0).uniform(-5.0, 5.0, (4, 3)).astype(np.float32)
cloud = PointCloud.from_points(
    (*places.T, PointCloud.encode_rgb(COLOURS), VARIANCES), ("x", "y", "z", "rgb", "variance"), (np.float32,) * 5)


def read(path):
    found = PointCloud.from_path(path)
    assert np.allclose(found.numpy(("x", "y", "z")), places, rtol=0.0, atol=1e-6)
    return PointCloud.decode_rgb(found.pc_data["rgb"]), found.pc_data["variance"]


found = {}
for encoding in (Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED):
    path = f"{encoding.value}.pcd"
    cloud.save(path, encoding=encoding)
    found[encoding.value] = read(path)
with open("nine.pcd", "wb") as file:
    file.write(cloud.metadata.compose_header(data=Encoding.ASCII).encode())
    np.savetxt(file, cloud.pc_data, "%.9g")
found["ascii, nine significant digits"] = read("nine.pcd")
print(f"written: colours {COLOURS.tolist()}, variances {VARIANCES.tolist()}")
for name, (colours, variances) in found.items():
    print(f"{name}: colours {colours.tolist()}, variances {variances.tolist()}")
    exact = bool(np.array_equal(colours, COLOURS) and np.array_equal(variances, VARIANCES))
    if exact == (name == "ascii"):
        sys.exit(f"{name} has changed")
lines = open("ascii.pcd").read().splitlines()
print(lines[-1])
black, variances = found["ascii"]
ok = not black.any() and abs(variances[0] - 1.23e-8) < 1e-13 and variances[2] == 0.0
sys.exit(not (ok and lines[-1].split()[3] == "0.0000000000"))
PY
