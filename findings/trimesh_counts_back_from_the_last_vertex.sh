#!/usr/bin/env bash
# trimesh 5.2.0 misreads the relative indices of an OBJ file. By the format, -1 is the last vertex that precedes the
# face in the file, so that a program can write object after object, each with the same `f -4 -3 -2 -1`. trimesh counts
# back from the last vertex of the whole file. All objects become copies of the last one, without an error: a room that
# is written wall by wall has one wall, six times. Only files with all vertices before all faces are read right.
# Upstream: the open issue github.com/mikedh/trimesh/issues/2364, with the closed pull request 2556.
# Write indices that count from the start of the file, or another format.
# Prints the meshes that are read from both kinds of indices, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'trimesh==5.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PY'
import sys

import trimesh

CORNERS = [(x, y, z) for x in (0, 4) for y in (0, 3) for z in (0, 5)]  # a room [m], of 94 square metres
WALLS = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
vertices = ["".join("v {} {} {}\n".format(*CORNERS[corner]) for corner in wall) for wall in WALLS]
starts = range(1, 25, 4)
absolute = [f"f {k} {k + 1} {k + 2} {k + 3}\n" for k in starts]
FILES = {
    "wall by wall, indices from the start": "".join(v + f for v, f in zip(vertices, absolute)),
    "wall by wall, relative indices": "".join(v + "f -4 -3 -2 -1\n" for v in vertices),
    "all vertices first, relative indices": "".join(vertices)
    + "".join(f"f {k - 25} {k - 24} {k - 23} {k - 22}\n" for k in starts),
}
found = []
for name, text in FILES.items():
    with open("room.obj", "w") as file:
        file.write(text)
    mesh = trimesh.load("room.obj", force="mesh")
    found.append((mesh.area, mesh.extents.tolist()))
    print(f"{name}: {len(mesh.faces)} triangles, {mesh.area:g} square metres, sides {mesh.extents.tolist()} m")
room, one_wall = (94.0, [4.0, 3.0, 5.0]), (6 * 12.0, [4.0, 3.0, 0.0])
sys.exit(found != [room, one_wall, room])
PY
