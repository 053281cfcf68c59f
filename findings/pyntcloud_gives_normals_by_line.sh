#!/usr/bin/env bash
# pyntcloud 0.3.1: `PyntCloud.from_file` reads OBJ files with normals into the columns nx, ny and nz of `points`. In
# such a file, the faces say which normal belongs to which vertex, as `f 1//3 2//1 3//2`. The library reads these
# indices into `mesh`, but gives each point the normal of the same line number. Nothing warns. If a file lists its
# normals in another order than its vertices, points have the normals of others; on a sphere, half of them look inward.
# If vertices share a normal, as in a plane, most points have none.
# Law: the order of the `vn` lines must not matter where the faces' indices follow it. On a unit sphere, the normal of
# each point is the point.
# Upstream: no issue of github.com/daavoo/pyntcloud that was found describes it.
# `mesh` is right: the normal of the vertex `v1` is on line `vn1`. pandas is 1.5.3, as 2.3.3 refuses the faces.
# Prints the angles between normals for three orders of the same file, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pyntcloud==0.3.1' 'pandas==1.5.3' 'numpy==1.26.4' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore::FutureWarning - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from pyntcloud import PyntCloud
from scipy.spatial import ConvexHull

COUNT = 200
print("pyntcloud", version("pyntcloud"))
random = np.random.default_rng(0)
points = random.normal(size=(COUNT, 3))
points /= np.linalg.norm(points, axis=1, keepdims=True)  # of a unit sphere: the normal of a point is the point
faces = ConvexHull(points).simplices


def write(name, vertices, normals, pairs):
    """Write an OBJ file, whose ``pairs`` has indices of vertex and normal, from zero, of all corners of each face."""
    with open(name, "w") as file:
        file.writelines("v {:.6f} {:.6f} {:.6f}\n".format(*row) for row in vertices)
        file.writelines("vn {:.6f} {:.6f} {:.6f}\n".format(*row) for row in normals)
        file.writelines("f " + " ".join(f"{v + 1}//{n + 1}" for v, n in face) + "\n" for face in pairs)


def angles(a, b):
    """Angles [degrees] between the rows of ``a`` and ``b``."""
    return np.degrees(np.arccos(np.clip(np.sum(a * b, axis=1), -1.0, 1.0)))


ok = True
ways = {"the vertices' order": np.arange(COUNT), "reverse order": np.arange(COUNT)[::-1],
        "random order": random.permutation(COUNT)}
for name, order in ways.items():
    line = np.argsort(order)  # of the normal of each vertex
    write("sphere.obj", points, points[order], [[(v, line[v]) for v in face] for face in faces])
    cloud = PyntCloud.from_file("sphere.obj")
    read = cloud.points[["x", "y", "z"]].to_numpy(float)
    normals = cloud.points[["nx", "ny", "nz"]].to_numpy(float)
    error = angles(normals, read)
    corner = np.concatenate([angles(normals[cloud.mesh[f"vn{i}"]], read[cloud.mesh[f"v{i}"]]) for i in (1, 2, 3)])
    inward = int(np.sum(error > 90.0))
    print(f"normals in {name}: off by up to {error.max():.2f} degrees, {inward} of {COUNT} look inward;"
          f" by the faces' indices up to {corner.max():.2f}")
    ok &= corner.max() < 0.1 and np.allclose(normals, points[order], atol=1e-5)
    ok &= error.max() < 0.1 if name.startswith("the") else inward > COUNT // 3
square = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)))
write("square.obj", square, [(0.0, 0.0, 1.0)], [[(0, 0), (1, 0), (2, 0)], [(0, 0), (2, 0), (3, 0)]])
shared = PyntCloud.from_file("square.obj").points[["nx", "ny", "nz"]].to_numpy(float)
without = int(np.isnan(shared).any(axis=1).sum())
print(f"a square, whose four corners share one normal: {without} of 4 points have none")
sys.exit(not (ok and without == 3 and np.allclose(shared[0], (0.0, 0.0, 1.0))))
PY
