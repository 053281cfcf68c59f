#!/usr/bin/env bash
# yostlabs-math 2026.3.11: `quaternion.slerp(a, b, t)` interpolates between two quaternions on the shortest way. The
# weight of the first one is sin((1 - t) theta) / sin(theta). The library computes sin(1 - t) theta / sin(theta). And it
# changes the sign of b for the shortest way, but not that of the dot product that theta is taken from. Nothing warns.
# So the way is right at its ends only. The middle of a turn by 170 degrees is 2.7 degrees off. For quaternions with
# opposite signs, a turn by 90 degrees is up to 11 degrees off.
# Law: the middle from a to b is that from b to a. A quaternion and its negative are one rotation, and the speed is
# constant. SciPy 1.17.1 interpolates so.
# Upstream: no issue of github.com/YostLabs/3SpacePythonPackage that was found describes it.
# Prints the errors for some turns, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'yostlabs-math==2026.3.11' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from yostlabs.math.quaternion import slerp

TIMES = np.linspace(0.0, 1.0, 101)
print("yostlabs-math", version("yostlabs-math"))
warnings.simplefilter("error")


def errors(degrees, sign):
    """Largest error, error in the middle, at the ends, and difference of the middles of both directions [degrees]."""
    pair = Rotation.from_euler("zyx", (20.0, 10.0, 5.0), degrees=True) * Rotation.from_rotvec(
        np.radians(degrees) * np.array(((0.0, 0.0, 0.0), (1.0, 2.0, 2.0))) / 3.0)
    first, second = pair[0].as_quat().tolist(), (sign * pair[1].as_quat()).tolist()
    if np.dot(first, second) * sign < 0.0:  # SciPy's signs
        second = [-value for value in second]
    found = Rotation.from_quat([slerp(first, second, t) for t in TIMES])
    off = np.degrees((found.inv() * Slerp((0.0, 1.0), pair)(TIMES)).magnitude())
    back = Rotation.from_quat(slerp(second, first, 0.5))
    return off.max(), off[50], off[[0, -1]].max(), np.degrees((found[50].inv() * back).magnitude())


ok = True
for degrees in (10.0, 45.0, 90.0, 135.0, 170.0):
    for sign, name in ((1.0, "equal"), (-1.0, "opposite")):
        largest, middle, ends, between = errors(degrees, sign)
        print(f"turn by {degrees:g} degrees, {name} signs: off by up to {largest:.2f} degrees, in the middle by"
              f" {middle:.2f}, at the ends by {ends:.1e}; the middles of both directions differ by {between:.2f}")
        ok &= ends < 1e-4 and largest > (0.1 if sign > 0.0 else 1.0) and between > 0.1
ok &= errors(170.0, 1.0)[1] > 2.0 and errors(90.0, -1.0)[0] > 10.0
sys.exit(not ok)
PY
