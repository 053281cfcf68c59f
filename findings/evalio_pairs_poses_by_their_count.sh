#!/usr/bin/env bash
# evalio 0.6.1: `stats.ate` and `stats.rte` are documented to align two trajectories that are not aligned. They take the
# two for aligned where the numbers of poses and the first poses are equal, and never look at the stamps. Odometry
# begins at the identity, so first poses are equal often. Poses are then paired by their index, whatever their times.
# An estimate that is exact at each of its stamps, but lost 20 frames of 100 and went on for 20 more, has an absolute
# error of 1.7 m. With one frame less, it has none.
# Law: a trajectory of true poses has no error.
# Upstream: no issue of github.com/contagon/evalio that was found describes it.
# Call `stats.align` before; it looks at the stamps.
# Prints the errors of exact estimates, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'rosbags==0.11.9' 'asteval==1.0.10' 'pyyaml==6.0.4' 'rich==15.0.0' 'tqdm==4.70.1'
"${pip[@]}" --no-deps 'evalio==0.6.1' # the rest is for its commands and downloads
cd "$folder"
cat >exact.py <<'PY'
import sys

import numpy as np
from evalio import stats
from evalio.types import SE3, SO3, Stamp, Trajectory

RATE, SPEED = 10, 1.0  # Hz, m/s


def trajectory(frames):
    """The true poses at some frames: a body that drives straight ahead, from the identity."""
    stamps = [Stamp.from_nsec(1_000_000_000 + int(k) * 1_000_000_000 // RATE) for k in frames]
    poses = [SE3(SO3(qx=0.0, qy=0.0, qz=0.0, qw=1.0), np.array([SPEED * k / RATE, 0.0, 0.0])) for k in frames]
    return Trajectory(stamps=stamps, poses=poses)


truth = trajectory(range(100))
lost = [k for k in range(120) if not 25 <= k < 45]  # 100 frames
found = {}
for name, frames in (("the same frames", range(100)), ("20 frames lost", lost), ("21 frames lost", lost[:-1])):
    estimate = trajectory(frames)
    absolute, relative = stats.ate(estimate, truth), stats.rte(estimate, truth, stats.WindowMeters(1.0))
    aligned = stats.ate(*stats.align(estimate, truth))
    found[name] = [float(error.sse().trans) for error in (absolute, relative, aligned)]
    print(f"{name}, {len(frames)} poses: absolute error {found[name][0]:.3f} m, relative error {found[name][1]:.3f} m,",
          f"absolute error after align {found[name][2]:.3f} m")
zero = [np.allclose(errors, 0.0, atol=1e-9) for errors in found.values()]
absolute, relative, aligned = found["20 frames lost"]
sys.exit(not (zero == [True, False, True] and absolute > 1.0 and relative > 0.1 and aligned < 1e-9))
PY
"$folder/venv/bin/python" exact.py
