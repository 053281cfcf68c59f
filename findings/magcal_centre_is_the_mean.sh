#!/usr/bin/env bash
# magcal 1.0.1: `MagnetometerCalibrator.calibrate` fits an ellipsoid to the measured field, to correct "both hard iron
# and soft iron effects". Its centre is the offset by hard iron. The library takes the mean of the samples for it, and
# fits only the shape. The mean is the centre only if the sensor turns evenly through all orientations. Nothing warns.
# If six of ten samples lie in one half, exact data of 50 uT give an offset that is 5.5 uT off. Directions of the field
# are then wrong by up to 6 degrees, and the library reports a good calibration.
# Law: samples on a sphere have its centre, wherever on it they lie. A linear fit of an ellipsoid with its centre finds
# it, and so does the library's own simpler method "sphere".
# Upstream: no issue of github.com/lundeen06/magcal that was found describes it.
# Prints the errors of the offsets for samples without noise, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'magcal==1.0.1' 'numpy==2.4.6' 'scipy==1.17.1' \
  'matplotlib==3.11.2' 'pyserial==3.5' 'rich==15.0.0' 'click==8.5.1' 'questionary==2.1.1'
cd "$folder"
MPLBACKEND=Agg "$folder/venv/bin/python" - <<'PY'
import contextlib
import io
import sys
import warnings
from importlib.metadata import version

import numpy as np
from magcal import MagnetometerCalibrator

COUNT, FIELD, OFFSET = 2000, 50.0, np.array((12.0, -30.0, 7.0))  # uT
print("magcal", version("magcal"))
warnings.simplefilter("error")


def samples(share):
    """Exact samples, of which a share lies in the upper half, as lists."""
    random = np.random.default_rng(0)
    found = random.normal(size=(COUNT, 3))
    found[:, 2] = np.abs(found[:, 2]) * np.where(np.arange(COUNT) < share * COUNT, 1.0, -1.0)
    found[1::2, :2] *= -1.0
    return (FIELD * found / np.linalg.norm(found, axis=1)[:, None] + OFFSET).tolist()


def offset(data, method):
    """Offset [uT] by a method, and the library's assessment."""
    calibrator, text = MagnetometerCalibrator(), io.StringIO()
    calibrator.raw_data = data
    with contextlib.redirect_stdout(text):
        center = calibrator.calibrate(method)["center"]
    return center, text.getvalue().strip().splitlines()[-1]


def linear(data):
    """Centre [uT] of the ellipsoid of a linear fit with nine parameters."""
    x, y, z = (np.array(data) / FIELD).T
    a, b, c, d, e, f, *linear = np.linalg.lstsq(
        np.c_[x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z], np.ones(len(x)), rcond=None)[0]
    return -0.5 * FIELD * np.linalg.solve(((a, d, e), (d, b, f), (e, f, c)), linear)


ok = True
for share in (0.5, 0.55, 0.6, 0.7):
    data = samples(share)
    (seen, words), (sphere, _) = offset(data, "ellipsoid"), offset(data, "sphere")
    errors = [np.linalg.norm(found - OFFSET) for found in (seen, sphere, linear(data))]
    print(f"{share:.0%} of the samples in the upper half: the offset is off by {errors[0]:.2f} uT ({words.lower()}); by"
          f" {errors[1]:.2f} with the method sphere, by {errors[2]:.1e} with a linear fit of the ellipsoid")
    ok &= np.allclose(seen, np.mean(data, axis=0)) and errors[1] < 0.01 and errors[2] < 1e-6
    ok &= np.isclose(errors[0], FIELD * abs(share - 0.5), atol=2.0)
sys.exit(not ok)
PY
