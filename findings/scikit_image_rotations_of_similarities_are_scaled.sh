#!/usr/bin/env bash
# scikit-image 0.26.0: `SimilarityTransform.rotation` of a transform in space is its matrix with the scale in it, so no
# rotation: with scale 2, its determinant is 8. In the plane, `rotation` is the angle without the scale. Nothing warns.
# A program that takes `rotation`, `scale` and `translation` apart, say of a map of one camera, and puts them
# together as scale * rotation @ x + translation, applies the scale twice.
# Law: a rotation keeps lengths. Scale, rotation and translation together are the transform. Scale 1 is right.
# Prints the determinants of rotations and the points of transforms put together, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'scikit-image==0.26.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from scipy.spatial.transform import Rotation
from skimage.transform import EuclideanTransform, SimilarityTransform

rng = np.random.default_rng(0)
R, shift = Rotation.from_rotvec((0.2, -0.4, 0.3)).as_matrix(), np.array((1.0, 2.0, 3.0))
points = rng.normal(size=(20, 3))
ok = True
for scale in (1.0, 2.0, 0.1):
    moved = scale * points @ R.T + shift
    found = SimilarityTransform.from_estimate(points, moved)
    together = found.scale * points @ found.rotation.T + found.translation
    right = found.scale * points @ (found.rotation / found.scale).T + found.translation
    print(f"scale {scale:g} in space: found {found.scale:.3f}, determinant of the rotation"
          f" {np.linalg.det(found.rotation):.3f}, largest errors: transform {np.abs(found(points) - moved).max():.0e},"
          f" parts together {np.abs(together - moved).max():.3f}")
    ok &= abs(found.scale - scale) < 1e-9 and bool(np.allclose(found(points), moved) and np.allclose(right, moved))
    ok &= abs(np.linalg.det(found.rotation) - scale**3) < 1e-9
    ok &= bool(np.allclose(together, moved)) == (scale == 1.0)
    plane = SimilarityTransform(scale=scale, rotation=0.3, dimensionality=2)
    turned = SimilarityTransform(scale=plane.scale) + EuclideanTransform(rotation=plane.rotation)
    print(f"  in the plane: scale {plane.scale:.3f}, rotation {plane.rotation:.3f} rad")
    ok &= bool(np.allclose(turned.params, plane.params)) and abs(plane.rotation - 0.3) < 1e-9
sys.exit(not ok)
PY
