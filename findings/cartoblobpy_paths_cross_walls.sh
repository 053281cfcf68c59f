#!/usr/bin/env bash
# cartoblobpy 0.0.10: `Graph.build_graph` of an occupancy grid promises "nodes for all non-obstacle cells" and edges
# between adjacent ones. It adds an edge from each free cell to all of its eight neighbours, and does not look whether
# they are free. NetworkX makes a node for each end of an edge. So all obstacles next to a free cell are nodes, and a
# wall that is one cell thick has edges from both sides. Nothing warns. The shortest path goes straight through the
# wall, though the map has a door, and the library's `is_free_path` says that the way is blocked.
# Law: a path through free cells exists in the free cells alone. Such a path is found without the other nodes.
# Walls of two cells or more are not crossed, but paths may end in them. `graph.remove_nodes_from` of the occupied cells
# makes it right.
# Prints nodes, paths and their lengths for walls of 0 to 3 cells, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'networkx==3.6.1' 'pillow==13.0.0' 'matplotlib==3.11.2' 'pyyaml==6.0.4'
"${pip[@]}" --no-deps 'cartoblobpy==0.0.10' # it asks for downloaders of maps too
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import networkx
import numpy as np
from cartoblobpy.graph import Graph
from PIL import Image

START, GOAL = (3, 3), (3, 17)
print("cartoblobpy", version("cartoblobpy"))
ok = True
for thickness in (0, 1, 2, 3):
    image = np.full((21, 21), 255, np.uint8)
    image[2:, 10:10 + thickness] = 0  # a door of two cells is left
    Image.fromarray(image).save("map.png")
    graph = Graph()
    graph.load_from_image("map.png")
    graph.build_graph()
    occupied = graph.grid > graph.occupancy_threshold
    path = networkx.shortest_path(graph.nodes, START, GOAL, weight="weight")
    inside = sum(bool(occupied[cell]) for cell in path)
    clean = graph.nodes.copy()
    clean.remove_nodes_from([cell for cell in graph.nodes if occupied[cell]])
    around = networkx.shortest_path(clean, START, GOAL, weight="weight")
    straight = graph.is_free_path(graph.grid_to_world(START), graph.grid_to_world(GOAL))
    nodes = sum(bool(occupied[cell]) for cell in graph.nodes)
    print(f"wall of {thickness} cells: {nodes} of {occupied.sum()} occupied cells are nodes; the path has {len(path)}"
          f" cells, {inside} of them in the wall; in the free cells alone it has {len(around)}; straight is"
          f" {'free' if straight else 'blocked'}")
    ok &= straight == (thickness == 0) and inside == (thickness == 1)
    ok &= nodes == occupied.sum() if thickness < 3 else 0 < nodes < occupied.sum()
    ok &= len(around) > 25 if thickness else len(around) == 15
sys.exit(not ok)
PY
