#!/usr/bin/env bash
# trimesh 5.2.0 reads the integers of a quantised glTF as metres. By the extension KHR_mesh_quantization, positions may
# be integers that are marked as normalized: 32767, of a signed 16-bit integer, stands for 1. trimesh ignores the mark.
# A room of 4 m becomes 131 km wide, without a warning, though the file says that its reader must know the extension.
# Numbers in floating point and integers without the mark are read right. glTF-Transform quantises this way, and
# gltfpack does with -vpn.
# Upstream: no issue of github.com/mikedh/trimesh that was found describes it. Assimp has the same fault, by its open pull
# request github.com/assimp/assimp/pull/6765.
# Prints the sizes that are read, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'trimesh==5.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PY'
import base64
import json
import sys

import numpy as np
import trimesh

FACES = trimesh.creation.box((4.0, 3.0, 4.0)).faces.astype("<u2")
CORNERS = trimesh.creation.box((4.0, 3.0, 4.0)).vertices  # a room [m]
# Name: type of a component, its code, whether it is normalized, and the scale of the node.
KINDS = {
    "floating point": ("<f4", 5126, False, 1.0),
    "integers in millimetres": ("<i2", 5122, False, 1e-3),
    "normalized signed 16 bit": ("<i2", 5122, True, 2.0),
    "normalized signed 8 bit": ("<i1", 5120, True, 2.0),
}
found = {}
for name, (kind, code, normalized, scale) in KINDS.items():
    stored = CORNERS / scale
    if normalized:
        stored = stored * np.iinfo(kind).max
    if kind != "<f4":
        stored = np.round(stored)
    size = np.dtype(kind).itemsize
    rows = np.zeros((8, 3 if size == 4 else 4), kind)  # each vertex begins at a multiple of four bytes
    rows[:, :3] = stored
    data = rows.tobytes() + FACES.tobytes()
    text = base64.b64encode(data).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [scale] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data), "uri": f"data:application/octet-stream;base64,{text}"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": rows.nbytes, "byteStride": rows.strides[0], "target": 34962},
            {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": FACES.nbytes, "target": 34963},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": code, "normalized": normalized, "count": 8, "type": "VEC3",
             "min": rows[:, :3].min(axis=0).tolist(), "max": rows[:, :3].max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5123, "count": FACES.size, "type": "SCALAR"},
        ],
    }
    if kind != "<f4":
        document["extensionsUsed"] = document["extensionsRequired"] = ["KHR_mesh_quantization"]
    with open("room.gltf", "w") as file:
        json.dump(document, file)
    found[name] = trimesh.load("room.gltf", force="mesh").extents
    print(f"{name}: {found[name].round(3)} m")
plain, integers, short, byte = (sizes / (4.0, 3.0, 4.0) for sizes in found.values())
ok = np.allclose(plain, 1.0) and np.allclose(integers, 1.0)
sys.exit(not (ok and np.allclose(short, 32767, rtol=1e-4) and np.allclose(byte, 127, rtol=1e-2)))
PY
