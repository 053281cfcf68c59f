#!/usr/bin/env bash
# quatlib 0.1.0: `rotMat2quatern(R)` converts a rotation matrix to a quaternion, and `quatern2rotMat(q)` converts it
# back. The documentation lists both, without a convention. The first takes SciPy's quaternion of R. The second builds
# the matrix of the conjugate. Nothing warns. So the way there and back returns the transpose. A camera that looks 30
# degrees to the left looks 30 degrees to the right. `quatern2euler(q)` uses the conjugate too, so it turns the signs:
# a yaw of 30 degrees that goes through a quaternion comes back as -30. Directly, by `rotMat2euler(R)`, it is right.
# Law: the round trip is the identity, and both ways from R to its Euler angles agree. SciPy 1.17.1 has R for q.
# Only half turns and no turn come back, as they are their own inverses.
# Upstream: the package names no repository, and no public issue that was found describes it.
# `quatern2rotMat(quaternConj(q))` is right.
# Prints the error of the round trip, and Euler angles by both ways, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'quatlib==0.1.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import quatlib
from scipy.spatial.transform import Rotation

print("quatlib", version("quatlib"))


def between(A, B):
    """Angle between two rotation matrices in degrees."""
    return np.degrees(np.linalg.norm(Rotation.from_matrix(A.T @ B).as_rotvec()))


ok = True
for axis in ((0.0, 0.0, 1.0), (1.0, 2.0, -2.0)):
    for degrees in (10.0, 30.0, 90.0, 180.0):
        R = quatlib.axisAngle2rotMat(np.array(axis), np.radians(degrees))
        q = quatlib.rotMat2quatern(R)
        back = quatlib.quatern2rotMat(q)
        repaired = quatlib.quatern2rotMat(quatlib.quaternConj(q))
        by_scipy = Rotation.from_quat(np.roll(q, -1)).as_matrix()
        print(f"{degrees:g} degrees about {axis}: the round trip is off by {between(R, back):.2f} degrees, with the"
              f" conjugate by {between(R, repaired):.1e}")
        ok &= np.allclose(back, R.T) and np.allclose(repaired, R) and np.allclose(by_scipy, R)
for angles in ((0.0, 0.0, 30.0), (0.0, 20.0, 0.0), (10.0, -20.0, 50.0)):
    R = quatlib.euler2rotMat(*np.radians(angles))
    direct = np.degrees(quatlib.rotMat2euler(R))
    around = np.degrees(quatlib.quatern2euler(quatlib.rotMat2quatern(R)))
    print(f"roll, pitch, yaw {angles}: by the matrix {np.round(direct, 2) + 0.0}, by the quaternion"
          f" {np.round(around, 2) + 0.0}")
    ok &= np.allclose(direct, angles) and not np.allclose(around, angles, atol=10.0)
    ok &= np.allclose(around, np.degrees(quatlib.rotMat2euler(R.T)))
sys.exit(not ok)
PY
