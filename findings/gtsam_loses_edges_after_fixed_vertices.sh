#!/usr/bin/env bash
# GTSAM 4.3.0: `readG2o(file, False)` and `load2D` read a planar pose graph. They expect two whole numbers after the tag
# of each line, before they look at the tag. A line `FIX 0`, by which g2o holds a vertex, has one, and a comment has
# none. There the reading of edges ends: all edges after it are lost, all poses are kept. Nothing warns. g2o writes
# `FIX` behind the vertex, before the edges, so such a file becomes a graph of poses without any edge.
# Law: lines of other kinds change no edge. `FIX 0 1` (two vertices) does not, nor `FIX 0` in `readG2o(file, True)`.
# Prints how many edges are read, and fails if that changes.
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

VERTICES = {
    False: [f"VERTEX_SE2 {i} {i} 0 0" for i in range(6)],
    True: [f"VERTEX_SE3:QUAT {i} {i} 0 0 0 0 0 1" for i in range(6)],
}
EDGES = {
    False: [f"EDGE_SE2 {i} {i + 1} 1 0 0 50 0 0 50 0 70" for i in range(5)],
    True: [f"EDGE_SE3:QUAT {i} {i + 1} 1 0 0 0 0 0 1 " + "9 0 0 0 0 0 9 0 0 0 0 9 0 0 0 9 0 0 9 0 9" for i in range(5)],
}


def count(lines, spatial):
    """Numbers of poses and of edges that GTSAM reads, the latter by load2D too."""
    Path("graph.g2o").write_text("\n".join(lines) + "\n")
    graph, values = gtsam.readG2o("graph.g2o", spatial)
    return values.size(), graph.size(), graph.size() if spatial else gtsam.load2D("graph.g2o")[0].size()


ok = True
for spatial in (False, True):
    vertices, edges = VERTICES[spatial], EDGES[spatial]
    for name, lines, expected in (
        ("no other line", vertices + edges, 5),
        ("FIX 0 first", ["FIX 0"] + vertices + edges, 0),
        ("FIX 0 before the edges", vertices + ["FIX 0"] + edges, 0),
        ("FIX 0 after two edges", vertices + edges[:2] + ["FIX 0"] + edges[2:], 2),
        ("FIX 0 last", vertices + edges + ["FIX 0"], 5),
        ("FIX 0 1 before the edges", vertices + ["FIX 0 1"] + edges, 5),
        ("a comment after two edges", vertices + edges[:2] + ["# loop closures"] + edges[2:], 2),
    ):
        poses, found, planar = count(lines, spatial)
        print(f"{'space' if spatial else 'plane'}, {name}: {poses} poses and {found} of 5 edges")
        ok &= poses == 6 and found == planar == (5 if spatial else expected)
sys.exit(not ok)
PY
