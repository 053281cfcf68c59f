#!/usr/bin/env bash
# pycamgeom 0.0.5: `Camera.project` maps a point to a pixel by a lens with radial and tangential distortion. It is
# documented as the OpenCV model. `Camera.backproject(u, v, z)` is documented to map a pixel back to the point at depth
# z. Its loop converges, but for another lens: it takes the radius in place of its square, and exchanges p1 and p2.
# Nothing warns. With k1 = -0.1 alone, as an ordinary camera has, a point 20 degrees off the axis comes back 2.5 % too
# far out. That is twice the distortion itself, so for most pixels it is better to leave out the correction.
# Law: projection of a back-projected pixel is the pixel. SciPy 1.17.1 inverts the same `project` numerically.
# Upstream: no issue of github.com/bmhopkinson/pycamgeom that was found describes it.
# Without distortion, the round trip is right.
# Prints the errors of the round trip in pixels, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pycamgeom==0.0.5' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from pycamgeom.camera import Camera
from scipy.optimize import root

print("pycamgeom", version("pycamgeom"))
DEPTH = 5.0  # m


def camera(**lens):
    """Camera of 1280 x 960 pixels with some coefficients of distortion."""
    found = Camera()
    found.fx = found.fy = 800.0
    found.cx, found.cy, found.dim = 640.0, 480.0, [1280.0, 960.0]
    found.K = np.array(((800.0, 0.0, 640.0), (0.0, 800.0, 480.0), (0.0, 0.0, 1.0)))
    for name, value in lens.items():
        setattr(found, name, value)
    return found


def pixel(lens, x, y):
    """Pixel of the point (x, y, 1)."""
    seen, found = lens.project(np.array(((DEPTH * x,), (DEPTH * y,), (DEPTH,), (1.0,))))
    assert seen
    return found


ok = True
for lens in ({}, {"k1": -0.1}, {"k1": -0.3, "k2": 0.1}, {"p1": 0.005}, {"p2": -0.005}):
    model = camera(**lens)
    for x, y in ((0.1, 0.05), (0.35, -0.1), (0.3, 0.4)):
        z = pixel(model, x, y)
        seen = model.backproject(*z, DEPTH)[:2] / DEPTH
        exact = root(lambda at: pixel(model, *at) - z, (x, y), tol=1e-12).x
        errors = [np.linalg.norm(pixel(model, *at) - z) for at in (seen, (z - (640.0, 480.0)) / 800.0, exact)]
        print(f"lens {lens}, point at ({x}, {y}): round trip off by {errors[0]:.2f} px, without a correction by"
              f" {errors[1]:.2f} px, by SciPy {errors[2]:.0e} px; radius {np.hypot(*seen) / np.hypot(x, y) - 1:+.1%}")
        ok &= errors[2] < 1e-6 and np.allclose(exact, (x, y))
        ok &= errors[0] > 0.1 if lens else errors[0] < 1e-9
        ok &= "k1" not in lens or errors[0] > errors[1]
        # What comes back solves the equation of a lens with |x| for its square, and with p1 and p2 exchanged.
        (a, b), r = seen, np.hypot(*seen)
        p1, p2 = lens.get("p1", 0.0), lens.get("p2", 0.0)
        other = seen * (1.0 + lens.get("k1", 0.0) * r + lens.get("k2", 0.0) * r**2)
        other += 2.0 * a * b * np.array((p1, p2)) + np.array((p2 * (r + 2.0 * a * a), p1 * (r + 2.0 * b * b)))
        ok &= np.allclose(800.0 * other + (640.0, 480.0), z, atol=1e-3)
    if lens == {"k1": -0.1}:
        x, y = seen = np.array((0.36397, 0.0))  # 20 degrees
        seen = model.backproject(*pixel(model, x, y), DEPTH)[:2] / DEPTH
        raw = (pixel(model, x, y)[0] - 640.0) / 800.0
        print(f"20 degrees off the axis: {seen[0] / x - 1.0:+.1%}, without a correction {raw / x - 1.0:+.1%}")
        ok &= seen[0] / x - 1.0 > 1.5 * abs(raw / x - 1.0)
sys.exit(not ok)
PY
