#!/usr/bin/env bash
# trimesh 5.2.0 splits a face of more than three corners into triangles that share one corner, whatever its shape. OBJ,
# PLY and OFF allow concave faces, as of the floor of an L-shaped room. Such a floor is read with a larger area, and a
# ray through the notch, where nothing is, hits it: without a warning, and depending on the corner that the file names
# first.
# mapbox_earcut, which triangulates polygons elsewhere in trimesh, changes nothing when it is installed.
# Upstream: the issue github.com/mikedh/trimesh/issues/2519 and the closed pull request 2560.
# Export triangles, or glTF and STL, which have nothing else.
# Prints area and ray for each first corner, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'trimesh==5.2.0' 'numpy==2.4.6' 'scipy==1.17.1' \
  'embreex==4.4.0.post1' 'mapbox_earcut==2.1.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import trimesh

FLOOR = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]  # an L of 12 square metres; nothing is at (3, 3)
HEAD = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
HEAD += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
areas, hits = set(), 0
for first in range(6):
    corners = FLOOR[first:] + FLOOR[:first]
    points = "".join(f"{x} {y} 0\n" for x, y in corners)
    texts = {
        "obj": "".join(f"v {line}\n" for line in points.splitlines()) + "f 1 2 3 4 5 6\n",
        "ply": HEAD + points + "6 0 1 2 3 4 5\n",
        "off": "OFF\n6 1 0\n" + points + "6 0 1 2 3 4 5\n",
    }
    row = []
    for kind, text in texts.items():
        with open(f"floor.{kind}", "w") as file:
            file.write(text)
        mesh = trimesh.load(f"floor.{kind}", force="mesh")
        hit = bool(mesh.ray.intersects_any([[3, 3, 1]], [[0, 0, -1]])[0])
        row.append(f"{kind} {mesh.area:g}{' hit' if hit else ''}")
        areas.add(round(float(mesh.area), 6))
        hits += hit
    print(f"first corner {corners[0]}:", ", ".join(row))
sys.exit(not (areas == {12.0, 16.0} and hits == 6))
PY
