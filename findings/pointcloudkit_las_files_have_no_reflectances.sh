#!/usr/bin/env bash
# pointcloudkit 0.1.0: `convert("scan.bin", "scan.las")` reads a lidar scan in KITTI's layout, the default for that
# ending, and writes a LAS file. KITTI's reflectances are between 0 and 1. All become 0 in the LAS file. Nothing warns.
# `LASFile.write` is documented to scale intensities to 16 bits by clipping. It only clips, and then drops what
# is behind the decimal point: `np.clip(pc.intensity, 0, 65535).astype(np.uint16)` in io/las.py. Colours are scaled.
# Law: a conversion keeps what the format can hold. PLY and PCD files of the same scan keep all reflectances, and a LAS
# file with the reflectances times 65535 keeps them to 16 bits. It is read by laspy alone, too.
# Upstream: no issue of github.com/mindkosh/pointcloudkit that was found describes it.
# Multiply `intensity` by 65535 before writing, and divide after reading.
# Prints the reflectances from four files, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pointcloudkit==0.1.0' 'laspy==2.7.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import laspy
import numpy as np
from pointcloudkit import PointCloud, convert

random = np.random.default_rng(0)
scan = np.column_stack([random.uniform(-50.0, 50.0, (1000, 3)), random.uniform(0.0, 0.99, 1000)]).astype(np.float32)
scan[:4, 3] = 0.05, 0.29, 0.5, 0.99
scan.tofile("scan.bin")
ok, found = True, {}
for kind in ("ply", "pcd", "las"):
    convert("scan.bin", f"scan.{kind}")
    cloud = PointCloud.read(f"scan.{kind}")
    ok &= np.allclose(cloud.position, scan[:, :3], atol=0.0051)
    found[kind] = cloud.intensity
repaired = PointCloud.read("scan.bin")
repaired.intensity *= 65535.0
repaired.write("repaired.las")
found["las, times 65535"] = PointCloud.read("repaired.las").intensity / 65535.0
print(f"written: {scan[:4, 3].tolist()}")
for kind, intensity in found.items():
    print(f"{kind}: {np.round(intensity[:4], 3).tolist()}, off by up to {np.abs(intensity - scan[:, 3]).max():.5f}")
    ok &= not intensity.any() if kind == "las" else np.allclose(intensity, scan[:, 3], atol=2e-5)
alone = laspy.read("scan.las").intensity
print(f"by laspy: {len(alone)} points, largest intensity {alone.max()}")
sys.exit(not (ok and len(alone) == 1000 and alone.max() == 0))
PY
