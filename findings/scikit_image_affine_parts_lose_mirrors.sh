#!/usr/bin/env bash
# scikit-image 0.26.0: `AffineTransform` is made of scale, rotation, shear and translation, and gives them back. `scale`
# is a root of squares, so never negative. A mirror ends in a shear over 90 degrees, of which the constructor takes the
# tangent: the sign is lost. Nothing warns. Parts of a transform that mirrors (one negative scale) belong to another
# one, which moves points elsewhere. The determinant is negative, and that of the parts put together is positive.
# Law: parts that a transform gives are those that it can be made of. Without a mirror, they are, with shear too.
# Prints parts, determinants and errors of transforms, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'scikit-image==0.26.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from skimage.transform import AffineTransform

corners = np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
ok = True
for scale, shear in (((2.0, 1.0), 0.0), ((2.0, 1.0), 0.2), ((-2.0, -1.0), 0.2), ((2.0, -1.0), 0.0), ((2.0, -1.0), 0.2),
                     ((-1.0, 1.0), 0.0)):
    first = AffineTransform(scale=scale, rotation=0.3, shear=shear, translation=(5.0, 6.0))
    again = AffineTransform(scale=first.scale, rotation=first.rotation, shear=first.shear,
                            translation=first.translation)
    error = np.abs(again(corners) - first(corners)).max()
    determinants = [np.linalg.det(transform.params) for transform in (first, again)]
    print(f"scale {scale}, rotation 0.3, shear {shear}: gives scale {first.scale.round(3)}, rotation"
          f" {first.rotation:.3f} and shear {first.shear:.3f}; of these, corners are wrong by {error:.3f}, determinants"
          f" {determinants[0]:.2f} and {determinants[1]:.2f}")
    mirror = scale[0] * scale[1] < 0.0
    ok &= (error > 1.0) == mirror and (error < 1e-9) != mirror and bool(np.all(first.scale > 0.0))
    ok &= abs(determinants[0] - (-1 if mirror else 1) * determinants[1]) < 1e-9
sys.exit(not ok)
PY
