#!/usr/bin/env bash
# pytransform3d 3.17.0: `estimate_gaussian_transform_from_samples` returns the mean and covariance of sampled poses. Its
# mean is wrong where the poses have turned by more than 60 degrees from the identity, however close together they
# are. For poses around (2, 1, 0) with a heading of 90 degrees, it is 5 m away; at 180 degrees, kilometres. The
# covariance is taken about that mean. Nothing warns.
# The documented iteration takes log(x m^-1), and multiplies the mean by an exponential on the left. The library takes
# log(m^-1 x), which belongs on the right. `estimate_gaussian_rotation_matrix_from_samples` has the same fault.
# Upstream: no issue of github.com/dfki-ric/pytransform3d that was found describes it.
# Take the poses relative to one of them before, and multiply the mean by it afterwards.
# Prints both estimates for samples of the library's own `random_transform`, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'pytransform3d==3.17.0' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pytransform3d.transformations import random_transform
from pytransform3d.uncertainty import (
    estimate_gaussian_rotation_matrix_from_samples,
    estimate_gaussian_transform_from_samples,
)

COVARIANCE = np.diag([0.01, 0.01, 0.05, 0.1, 0.1, 0.1]) ** 2  # radians, metres


def heading(R):
    return np.degrees(np.arctan2(R[1, 0], R[0, 0]))


errors = {}
for angle in (0, 30, 50, 90, 120, 180):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    mean = np.array([[c, -s, 0, 2], [s, c, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
    rng = np.random.default_rng(0)
    samples = np.array([random_transform(rng, mean, COVARIANCE) for _ in range(500)])
    pose, _ = estimate_gaussian_transform_from_samples(samples)
    R, _ = estimate_gaussian_rotation_matrix_from_samples(samples[:, :3, :3])
    plain = samples.mean(axis=0)  # of numbers; close to the mean, since the samples are
    errors[angle] = np.linalg.norm(pose[:3, 3] - plain[:3, 3])
    print(f"heading {angle}: mean {pose[:3, 3].round(2)} m, {heading(pose):.1f} degrees, of rotations alone",
          f"{heading(R):.1f}; numbers alone {plain[:3, 3].round(2)} m, {heading(plain):.1f}")
sys.exit(not (max(errors[a] for a in (0, 30, 50)) < 0.1 and min(errors[a] for a in (90, 120, 180)) > 3.0))
PY
