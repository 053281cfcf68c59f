#!/usr/bin/env bash
# rowan 1.3.2: `geometry.riemann_log_map(p, q)` is documented as the inverse of `riemann_exp_map(p, v)`, which is
# p exp(v). So it should be log(p^-1 q), the way from p to q. It returns log(q^-1 p), the way back. From p, that way
# leads as far to the other side: for q at 40 degrees, half of the way ends 60 degrees from q, and all of it 80 degrees.
# The usual iteration for the mean of orientations, exp(p, mean of log(p, q)), runs away from them.
# The length of the logarithm is right, and so are distances.
# Law: exp(p, log(p, q)) = q.
# Upstream: no issue of github.com/glotzerlab/rowan that was found describes it.
# With its arguments exchanged, `riemann_log_map(q, p)`, it is the inverse.
# Prints angles to q, and to the true mean in each iteration, for both orders, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'rowan==1.3.2' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
import rowan
from rowan.geometry import riemann_exp_map, riemann_log_map

MAPS = {"documented order": riemann_log_map, "exchanged": lambda p, q: riemann_log_map(q, p)}


def between(a, b):
    """The angle between two orientations in degrees."""
    return float(np.degrees(2.0 * np.arccos(min(1.0, abs(np.dot(a, b))))))


p = rowan.from_axis_angle([1.0, 2.0, 3.0], 0.7)
q = rowan.multiply(p, rowan.from_axis_angle([0.0, 0.6, 0.8], np.radians(40.0)))
truth = rowan.from_axis_angle([0.0, 0.0, 1.0], 0.5)  # the mean of six orientations, 0.2 rad to both sides of each axis
offsets = np.concatenate([np.eye(3), -np.eye(3)])
samples = rowan.multiply(truth, rowan.from_axis_angle(offsets, 0.2))
found = {}
for name, log in MAPS.items():
    v = log(p, q)
    way = [between(riemann_exp_map(p, part * v), q) for part in (0.0, 0.5, 1.0)]
    mean, off = samples[0], []
    for _ in range(4):
        off.append(between(mean, truth))
        mean = riemann_exp_map(mean, np.mean([log(mean, sample) for sample in samples], axis=0))
    found[name] = way, off
    print(f"{name}: none, half and all of the way from p end {np.round(way, 2)} degrees from q;",
          f"the mean is off by {np.round(off, 2)} degrees")
(way, off), (way_back, off_back) = found.values()
right = np.allclose(way_back, [40.0, 20.0, 0.0], atol=1e-5) and off_back[-1] < 0.01
sys.exit(not (right and np.allclose(way, [40.0, 60.0, 80.0], atol=1e-5) and np.all(np.diff(off) > 1.0)))
PY
