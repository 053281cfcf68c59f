#!/usr/bin/env bash
# gnsstoolbox 1.2.21: `gnsstools.toolRotY(X, Y, Z, alpha)` is documented as a rotation around the Y axis. In its matrix,
# one of the zeros is a 1. So Y is added to Z, whatever the angle. Nothing warns. A turn by zero moves a place near
# Sydney by 2550 km. No angle takes a turn back.
# Law: a rotation keeps lengths, and the turn by the opposite angle undoes it. SciPy 1.17.1 has the matrix. The
# library's own `toolRotX` and `toolRotZ` agree with it.
# Points of the plane of X and Z are right. For all others, take Y off the third coordinate of the result.
# Prints lengths, errors, and the way there and back for three places, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gnsstoolbox==1.2.21' 'gpsdatetime==1.0.45' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore::SyntaxWarning - <<'PY'
import sys

import numpy as np
from gnsstoolbox import gnsstools
from scipy.spatial.transform import Rotation

PLACES = {"Sydney": (-4646000.0, 2553000.0, -3534000.0), "Paris": (4201599.0, 189882.0, 4779085.0),
          "in the plane of X and Z": (4000000.0, 0.0, 4970000.0)}
TURNS = {"X": gnsstools.toolRotX, "Y": gnsstools.toolRotY, "Z": gnsstools.toolRotZ}
ok = True
for name, place in PLACES.items():
    for axis, turn in TURNS.items():
        for degrees in (0.0, 40.0):
            angle = np.radians(degrees)
            seen = np.array(turn(*place, angle))
            true = Rotation.from_euler(axis, angle).apply(place)
            back = np.linalg.norm(np.array(turn(*seen, -angle)) - place)
            off = seen - true
            print(f"{name}, turn about {axis} by {degrees:g} degrees: {np.linalg.norm(off) / 1e3:.0f} km off, length"
                  f" {np.linalg.norm(seen) / np.linalg.norm(place):.3f} of the true one, there and back"
                  f" {back / 1e3:.0f} km off")
            ok &= np.allclose(off, (0.0, 0.0, place[1] if axis == "Y" else 0.0), rtol=0.0, atol=1e-3)
            ok &= (back > 1e5) == (axis == "Y" and place[1] != 0.0)
sys.exit(not ok)
PY
