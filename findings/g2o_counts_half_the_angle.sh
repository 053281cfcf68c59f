#!/usr/bin/env bash
# One pose graph in g2o's format has two meanings. The last three rows of the information of an EDGE_SE3:QUAT weigh the
# vector of the quaternion in g2o (g2o-python 0.0.12), which is half the angle. GTSAM 4.3.0 reads them as weights of the
# angle itself. So an error of 0.1 rad costs 1 in g2o and 4 in GTSAM, while translations cost the same. Each reaches its
# own optimum: the loop below ends 5 cm apart. Who writes the covariance of an angle for g2o multiplies its inverse by
# four; who compares the chi squares of both cannot.
# Upstream: github.com/RainerKuemmerle/g2o/issues/699 says that the rows are those of qx, qy and qz.
# Prints costs and optima of both, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" # with NumPy 1, which the wheel of g2o-python needs
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gtsam==4.3.0' 'g2o-python==0.0.12' 'numpy==1.26.4'
cd "$folder"
cat >graphs.py <<'PY'
import numpy as np

INFORMATION = np.diag([100.0, 100.0, 100.0, 400.0, 400.0, 400.0])  # deviations 0.1 m, and 0.05 of what rows 4 to 6 are


def pose(x, y, heading):
    """Position and quaternion (x, y, z, w)."""
    return np.array([x, y, 0.0, 0.0, 0.0, np.sin(0.5 * heading), np.cos(0.5 * heading)])


POSES = [pose(0.0, 0.0, 0.0), pose(2.0, 0.0, 0.0), pose(4.0, 0.0, 0.0)]
STEP, LOOP = pose(2.0, 0.0, 0.0), pose(4.0, 0.5, 0.0)
# Name: vertices, and edges as (from, to, measurement).
GRAPHS = {
    "moved by 0.1 m": ([pose(0.0, 0.0, 0.0), pose(2.1, 0.0, 0.0)], [(0, 1, STEP)]),
    "turned by 0.1 rad": ([pose(0.0, 0.0, 0.0), pose(2.0, 0.0, 0.1)], [(0, 1, STEP)]),
    "loop": (POSES, [(0, 1, STEP), (1, 2, STEP), (0, 2, LOOP)]),
}
PY
cat >by_g2o.py <<'PY'
import json

import g2o
import numpy as np
from graphs import GRAPHS, INFORMATION


def isometry(p):
    return g2o.Isometry3d(g2o.Quaternion(np.array([p[6], p[3], p[4], p[5]])), np.array(p[:3]))


found = {}
for name, (poses, edges) in GRAPHS.items():
    optimizer, vertices, rows = g2o.SparseOptimizer(), [], []
    solver = g2o.BlockSolverSE3(g2o.LinearSolverEigenSE3())
    optimizer.set_algorithm(g2o.OptimizationAlgorithmLevenberg(solver))
    for k, p in enumerate(poses):
        vertices.append(g2o.VertexSE3())
        vertices[k].set_id(k)
        vertices[k].set_estimate(isometry(p))
        vertices[k].set_fixed(k == 0)
        optimizer.add_vertex(vertices[k])
    for i, j, p in edges:
        edge = g2o.EdgeSE3()
        edge.set_vertex(0, vertices[i])
        edge.set_vertex(1, vertices[j])
        edge.set_measurement(isometry(p))
        edge.set_information(INFORMATION)
        optimizer.add_edge(edge)
    optimizer.initialize_optimization()
    optimizer.compute_active_errors()
    before = optimizer.active_chi2()
    optimizer.optimize(100)
    found[name] = before, [float(v.estimate().translation().ravel()[1]) for v in vertices]
print(json.dumps(found))
PY
cat >by_gtsam.py <<'PY'
import json

import gtsam
from graphs import GRAPHS, INFORMATION

found = {}
upper = " ".join(f"{INFORMATION[i, j]:g}" for i in range(6) for j in range(i, 6))
for name, (poses, edges) in GRAPHS.items():
    with open("graph.g2o", "w") as file:
        for k, p in enumerate(poses):
            print("VERTEX_SE3:QUAT", k, *p, file=file)
        for i, j, p in edges:
            print("EDGE_SE3:QUAT", i, j, *p, upper, file=file)
    graph, values = gtsam.readG2o("graph.g2o", True)
    before = 2.0 * graph.error(values)
    graph.add(gtsam.PriorFactorPose3(0, values.atPose3(0), gtsam.noiseModel.Constrained.All(6)))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    found[name] = before, [float(values.atPose3(k).translation()[1]) for k in range(len(poses))]
print(json.dumps(found))
PY
"$folder/venv/bin/python" by_g2o.py 2>/dev/null >g2o.json
"$folder/venv/bin/python" by_gtsam.py >gtsam.json
"$folder/venv/bin/python" - <<'PY'
import json
import sys

import numpy as np

g2o, gtsam = (json.load(open(f"{name}.json")) for name in ("g2o", "gtsam"))
for name in g2o:
    print(f"{name}: g2o costs {g2o[name][0]:.3f} and ends at y = {np.round(g2o[name][1], 4)} m,",
          f"GTSAM costs {gtsam[name][0]:.3f} and ends at y = {np.round(gtsam[name][1], 4)} m")
moved, turned, loop = ([found[name][0] for found in (g2o, gtsam)] for name in g2o)
ok = np.allclose(moved, 1.0) and np.allclose(turned, (400.0 * np.sin(0.05) ** 2, 4.0)) and np.ptp(loop) < 1e-6
sys.exit(not (ok and np.abs(np.subtract(g2o["loop"][1], gtsam["loop"][1])).max() > 0.02))
PY
