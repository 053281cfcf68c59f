#!/usr/bin/env bash
# GTSAM 4.3.0: `readG2o(file, False)` reads the landmarks (`VERTEX_XY`) of a planar graph in g2o's format, and skips all
# their observations (`EDGE_SE2_XY`). Nothing warns. The landmarks are values without a factor, and an optimizer leaves
# them at the first guess of the file: it reports success, and observations have no effect, neither on landmarks nor on
# poses. In space, `VERTEX_TRACKXYZ` and `EDGE_SE3_TRACKXYZ` are both read.
# Law: a file of poses and landmarks has a factor for each edge. The landmark below is seen 1 m away, at (1, 1).
# Prints the factors and values that are read, and the optimized landmark, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gtsam==4.3.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys
from pathlib import Path

import gtsam
import numpy as np

PLANE = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_XY 7 2 2
EDGE_SE2 0 1 1 0 0 50 0 0 50 0 70
EDGE_SE2_XY 0 7 1 1 90 0 90
EDGE_SE2_XY 1 7 0 1 90 0 90
"""
SPACE = """VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1
VERTEX_TRACKXYZ 7 2 2 0
PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 50 0 0 0 0 0 50 0 0 0 0 50 0 0 0 70 0 0 70 0 70
EDGE_SE3_TRACKXYZ 0 7 0 1 1 0 90 0 0 90 0 90
EDGE_SE3_TRACKXYZ 1 7 0 0 1 0 90 0 0 90 0 90
"""
ok = True
for name, text, spatial in (("plane", PLANE, False), ("space", SPACE, True)):
    Path("graph.g2o").write_text(text)
    graph, values = gtsam.readG2o("graph.g2o", spatial)
    factors = [graph.at(i).keys() for i in range(graph.size())]
    landmark = gtsam.Symbol("l", 7).key()
    if spatial:
        graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    else:
        graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
    result = gtsam.GaussNewtonOptimizer(graph, values).optimize()
    place = result.atPoint3(landmark) if spatial else result.atPoint2(landmark)
    observed = sum(landmark in keys for keys in factors)
    print(f"{name}: {values.size()} values, {len(factors)} factors for 3 edges, {observed} of them of the landmark;"
          f" optimized, it is at {place.round(3)}")
    ok &= values.exists(landmark) and values.size() == 3
    ok &= (len(factors), observed) == ((3, 2) if spatial else (1, 0))
    ok &= bool(np.allclose(place, (1.0, 1.0, 0.0) if spatial else (2.0, 2.0), atol=1e-6))
sys.exit(not ok)
PY
