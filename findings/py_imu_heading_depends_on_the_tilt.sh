#!/usr/bin/env bash
# py-imu 0.1.0: `qmag2h(q, mag)` and `rpymag2h(rpy, mag)` are documented to give a "tilt compensated heading from
# compass". They turn the measured field back by the roll and the pitch. The attitude has its roll innermost, so the
# roll has to be undone first. The library undoes the pitch first. Nothing warns. For a body that only rolls or only
# pitches, the heading is right. With both angles at 30 degrees, it is up to 24 degrees off.
# Law: the heading of a tilted body, measured without noise, is that of its attitude. The library's own `q2rpy` and
# `accelmag2rpy` give it.
# Upstream: no issue of github.com/TUM-Aries-Lab/py-imu that was found describes it.
# Right is the third angle of `accelmag2rpy`.
# Prints the headings for some attitudes, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'py-imu==0.1.0' 'numpy==2.4.6' 'scipy==1.17.1' \
  'loguru==0.7.3'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from py_imu.fusion.quaternion import Quaternion, Vector3D
from py_imu.fusion.utilities import accelmag2rpy, q2rpy, qmag2h, rpymag2h
from scipy.spatial.transform import Rotation

FIELD = np.array((np.cos(np.radians(60.0)), 0.0, np.sin(np.radians(60.0))))  # to the north and downwards, as in Rome
DOWN = np.array((0.0, 0.0, 1.0))  # the library's accelerometer at rest
print("py-imu", version("py-imu"))


def difference(angle, other):
    """Difference [degrees] of two angles [degrees]."""
    return (angle - other + 180.0) % 360.0 - 180.0


def headings(roll, pitch, yaw):
    """Errors [degrees] of the headings by ``qmag2h``, ``rpymag2h``, ``accelmag2rpy`` and ``q2rpy``."""
    attitude = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True)  # body to world
    mag, acc = (Vector3D(*attitude.inv().apply(vector)) for vector in (FIELD, DOWN))
    q = Quaternion(*attitude.as_quat(scalar_first=True))
    found = qmag2h(q, mag), rpymag2h(q2rpy(q), mag), accelmag2rpy(acc, mag).z, q2rpy(q).z
    return [difference(np.degrees(angle), yaw) for angle in found]


ok = True
for tilt in ((0.0, 0.0), (30.0, 0.0), (0.0, 30.0), (10.0, 10.0), (20.0, 20.0), (30.0, 30.0)):
    errors = np.abs([headings(*tilt, yaw) for yaw in np.arange(-175.0, 180.0, 5.0)]).max(axis=0)
    print(f"roll {tilt[0]:g} and pitch {tilt[1]:g} degrees: the heading is off by up to {errors[0]:.2f} degrees by"
          f" qmag2h, {errors[1]:.2f} by rpymag2h, {errors[2]:.1e} by accelmag2rpy, {errors[3]:.1e} by q2rpy")
    ok &= np.isclose(errors[0], errors[1], atol=1e-6) and errors[2:].max() < 1e-6
    ok &= errors[0] < 1e-6 if min(tilt) == 0.0 else errors[0] > 0.1 * tilt[0]
sys.exit(not ok)
PY
