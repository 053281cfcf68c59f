#!/usr/bin/env bash
# pyest 0.7.2: `EllipticalFieldOfView(center, width, height, angle)` is the field of view of a sensor in a plane, with
# the angle "measured counter-clockwise". `apply_linear_transformation(A)` returns the field of view after the matrix A.
# For it, the library keeps the two half axes as vectors, but turns them by minus the angle. Nothing warns. So each
# transformation mirrors the ellipse first. The identity takes an angle of 30 degrees to -30. A turn of the sensor by 20
# degrees takes it to -10 in place of 50.
# Law: the transformed field of view contains the transformed point if and only if the field of view contains the point.
# The library's own `contains` decides both. Its polygons obey the law.
# Upstream: no issue of github.com/scope-lab/pyest that was found describes it.
# `contains` of an ellipse that was not transformed is right, and so is one at 0 or 90 degrees after a transformation.
# Prints angles, and the share of points for which the law is broken, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pyest==0.7.2' 'numpy==2.4.6' 'scipy==1.17.1' \
  'shapely==2.2.0' 'jax==0.10.2' 'numba==0.68.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore::DeprecationWarning - <<'PY'
import sys

import numpy as np
from pyest.sensors.FieldOfView import EllipticalFieldOfView, PolygonalFieldOfView


def turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(((c, -s), (s, c)))


CENTRE, WIDTH, HEIGHT = np.array((3.0, 1.0)), 8.0, 2.0
POINTS = CENTRE + np.random.default_rng(0).uniform(-5.0, 5.0, (5000, 2))
MATRICES = {"identity": np.eye(2), "turn by 20 degrees": turn(20.0), "twice as large": 2.0 * np.eye(2)}
ok = True
for angle in (0.0, 30.0, 60.0, 90.0):
    around = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    outline = np.column_stack((0.5 * WIDTH * np.cos(around), 0.5 * HEIGHT * np.sin(around))) @ turn(angle).T + CENTRE
    ellipse = EllipticalFieldOfView(CENTRE, WIDTH, HEIGHT, np.radians(angle))
    polygon = PolygonalFieldOfView(outline)
    assert np.mean(ellipse.contains(POINTS) != polygon.contains(POINTS)) < 0.005
    for name, matrix in MATRICES.items():
        broken = []
        for view in (ellipse, polygon):
            after = view.apply_linear_transformation(matrix)
            broken.append(np.mean(after.contains(POINTS @ matrix.T) != view.contains(POINTS)))
        after = np.degrees(ellipse.apply_linear_transformation(matrix).angle)
        due = angle + (20.0 if "turn" in name else 0.0)
        print(f"ellipse at {angle:g} degrees, {name}: at {after:.1f} degrees; the law is broken for {broken[0]:.1%} of"
              f" points, as a polygon for {broken[1]:.1%}")
        ok &= broken[1] < 1e-3 and np.isclose(np.cos(np.radians(after - due + 2.0 * angle)), 1.0)
        ok &= (broken[0] > 0.1) if angle in (30.0, 60.0) else (broken[0] < 1e-3)
sys.exit(not ok)
PY
