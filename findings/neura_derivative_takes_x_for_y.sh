#!/usr/bin/env bash
# neura-dual-quaternions 0.0.4: `Quaternion.exp_dot` returns the derivative of the exponential of a vector (x, y, z), as
# a matrix of 4 rows and 3 columns. In the last row, the element for y has the product of x and z in place of y and z.
# Nothing warns. It is right only if x equals y or z is zero. Else, it may have the wrong sign, and the velocity of the
# quaternion changes its length.
# Law: the derivative by central differences of the library's own `exp`. That of a unit quaternion is orthogonal to it.
# Upstream: no issue about it was found. The package names no repository.
# The second derivative, `exp_ddot`, is right.
# Prints the errors of the derivatives for some vectors, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'neura-dual-quaternions==0.0.4' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from neura_dual_quaternions import Quaternion

print("neura-dual-quaternions", version("neura-dual-quaternions"))


def exponential(vector):
    """Exponential of ``vector`` as (w, x, y, z)."""
    return Quaternion.exp(Quaternion(0.0, *vector)).asVector().ravel()


def first(vector, step=1e-5):
    """Derivative of the exponential by central differences, 4 rows and 3 columns."""
    return np.array([exponential(vector + d) - exponential(vector - d) for d in step * np.eye(3)]).T / (2.0 * step)


def second(vector, step=1e-4):
    """Second derivative of the exponential by central differences."""
    return np.array([first(vector + d) - first(vector - d) for d in step * np.eye(3)]).transpose(1, 2, 0) / (2.0 * step)


ok = True
for vector in ((0.3, 0.3, 0.8), (0.3, 0.6, 0.0), (0.0, 0.9, 0.9), (1.2, 0.0, 0.6), (0.5, -1.0, 1.5)):
    vector = np.array(vector)
    q = Quaternion(0.0, *vector)
    seen, true = Quaternion.exp_dot(q), first(vector)
    error = np.abs(seen - true)
    rest = np.delete(error.ravel(), 10).max()
    drift = exponential(vector) @ seen[:, 1]
    x, y, z = vector
    angle = np.linalg.norm(vector)
    expected = (np.cos(angle) - np.sin(angle) / angle) / angle**2 * (x - y) * z
    print(f"vector {vector}: the derivative of z by y is {seen[3, 1]:.4f}, right is {true[3, 1]:.4f}; all others are"
          f" off by up to {rest:.1e}; the length grows with y by {drift:.4f}")
    ok &= np.isclose(seen[3, 1] - true[3, 1], expected, atol=1e-6) and rest < 1e-6
    ok &= np.abs(Quaternion.exp_ddot(q) - second(vector)).max() < 1e-4
    ok &= (error[3, 1] < 1e-6) == (x == y or z == 0.0)
sys.exit(not ok)
PY
