#!/usr/bin/env bash
# nanomanifold 0.8.0: `SO3.to_euler(q, convention="ZYZ")` finds three Euler angles of which the first and the last are
# about one axis. Where the middle one is zero, these two are found as arctangents of zeros, so they depend on the signs
# of the zeros alone. Nothing warns. The identity becomes a half turn about z. Of all turns about z, as of the headings
# of a robot in the plane, one half become a half turn and the other half none at all.
# All twelve conventions with a repeated axis have it, down to a middle angle of 1e-9 rad. With 1e-6 rad they are right.
# The twelve with three axes lose angles where the middle one is 90 degrees; those are right for turns in the plane.
# Law: `SO3.from_euler` undoes `to_euler`. SciPy 1.17.1 sets the last angle to zero, warns, and has the turn.
# `SO3.to_axis_angle(q)` is right.
# Prints what headings become, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'nanomanifold==0.8.0' 'jaxtyping==0.3.11' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import itertools
import sys

import numpy as np
from nanomanifold import SO3
from scipy.spatial.transform import Rotation


def off(turn, convention):
    """Angles, and the degrees between a turn and what its angles make."""
    angles = SO3.to_euler(np.roll(turn.as_quat(), 1), convention=convention)
    back = Rotation.from_quat(np.roll(SO3.from_euler(angles, convention=convention), -1))
    return np.degrees(angles), np.degrees((back.inv() * turn).magnitude())


ok = True
headings = np.array((-150.0, -90.0, -30.0, 0.0, 30.0, 90.0, 150.0))
for heading in headings:
    turn = Rotation.from_euler("Z", heading, degrees=True)
    angles, wrong = off(turn, "ZYZ")
    scipy = turn.as_euler("ZYZ", degrees=True)
    vector = np.degrees(SO3.to_axis_angle(np.roll(turn.as_quat(), 1)))
    print(f"heading {heading:g}: ZYZ {angles.round(3) + 0.0}, off by {wrong:.3f} degrees; SciPy {scipy.round(3) + 0.0},"
          f" rotation vector {vector.round(3) + 0.0}")
    ok &= bool(np.isclose(abs(angles).sum() % 180.0, 0.0) and np.isclose(scipy[0] + scipy[2], heading))
    ok &= bool(np.isclose(vector[2], heading) and wrong > 29.0)
    ok &= bool(off(turn, "ZYX")[1] < 1e-6)
ok &= np.isclose(off(Rotation.identity(), "ZYZ")[1], 180.0)
names = ["".join(axes) for letters in ("xyz", "XYZ") for axes in itertools.permutations(letters, 2)]
for name in names:
    convention = name + name[0]
    turns = [Rotation.from_euler(convention, (20.0, np.degrees(middle), 10.0), degrees=True) for middle in (0.0, 1e-6)]
    errors = [off(turn, convention)[1] for turn in turns]
    print(f"{convention} (20, 0, 10): off by {errors[0]:.3f} degrees; with a middle angle of 1e-6 rad {errors[1]:.1e}")
    ok &= bool(errors[0] > 29.0 and errors[1] < 0.01)
sys.exit(not ok)
PY
