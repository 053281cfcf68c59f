#!/usr/bin/env bash
# GTSAM 4.3.0: `writeG2o` writes every number with six significant digits. Poses in metres of a map projection, as of a
# pose graph with GPS, lose their metres: steps of 1 m are read back as 10 m and 0 m, beside edges that still tell 1 m,
# so the file contradicts itself. Quaternions lose half of their digits. Nothing warns; the format asks for no rounding.
# Subtract an origin before writing.
# Prints the steps before and after, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gtsam==4.3.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gtsam
import numpy as np

R = gtsam.Rot3.RzRyRx(0.1, 0.2, 0.3)
places = np.array((482315.2371, 5431234.5678, 112.3456)) + np.arange(4)[:, None] * (0.0, 1.0, 0.0)
values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
for k, place in enumerate(places):
    values.insert(k, gtsam.Pose3(R, place))
model = gtsam.noiseModel.Diagonal.Sigmas(np.full(6, 0.01))
for k in range(3):
    graph.add(gtsam.BetweenFactorPose3(k, k + 1, values.atPose3(k).between(values.atPose3(k + 1)), model))
gtsam.writeG2o(graph, values, "graph.g2o")
edges, again = gtsam.readG2o("graph.g2o", True)
read = np.array([again.atPose3(k).translation() for k in range(4)])
with open("graph.g2o") as file:
    print(file.readline().strip())
print("steps written [m]:", np.diff(places[:, 1]), "| read [m]:", np.diff(read[:, 1]),
      f"| error of the graph: {graph.error(values):.3g} written, {edges.error(again):.3g} read")
sys.exit(not (np.abs(read - places)[:, 1].max() > 2.0 and graph.error(values) < 1e-6 and edges.error(again) > 1e3))
PY
