#!/usr/bin/env bash
# pylieg 0.2.5: `analysis.umeyama(points1, points2)` is documented to find the similarity that takes the points to the
# others, and `analysis.align_trajectory` aligns a trajectory by it. To exclude reflections, the library looks at the
# sign of the determinant of a covariance matrix. For points of a plane, as of a robot on a floor, this determinant is
# zero, so rounding decides. Nothing warns. In half of 100 frames, a figure of eight is aligned by a reflection. All
# positions agree, and each orientation is a matrix with the determinant -1.
# Law: a rotation has the determinant 1. Umeyama's method takes the sign from the product of the determinants of the two
# orthogonal matrices of the decomposition, if the points lie in a plane. SciPy 1.17.1 finds the rotations.
# Upstream: no issue of github.com/pvangoor/pylie that was found describes it.
# A path that leaves the plane is aligned by the true rotation.
# Prints the determinants and the errors of the orientations, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pylieg==0.2.5' 'numpy==2.4.6' 'scipy==1.17.1' \
  'matplotlib==3.11.2'
cd "$folder"
MPLBACKEND=Agg "$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from pylie import SE3, Trajectory
from pylie.analysis import align_trajectory
from scipy.spatial.transform import Rotation

COUNT = 100
print("pylieg", version("pylieg"))
time = np.linspace(0.0, 20.0, 41)


def poses(height):
    """Poses along a figure of eight, whose height [m] varies by ``height``."""
    found = np.tile(np.eye(4), (len(time), 1, 1))
    found[:, :3, 3] = np.c_[5.0 * np.sin(0.4 * time), 3.0 * np.sin(0.8 * time), height * np.cos(1.1 * time)]
    forward = np.arctan2(2.4 * np.cos(0.8 * time), 2.0 * np.cos(0.4 * time))
    found[:, :3, :3] = Rotation.from_euler("z", forward[:, None]).as_matrix()
    return found


def align(path, motion):
    """Determinant of the rotation that aligns ``path``; largest errors of positions [m] and rotation matrices."""
    goal = motion @ path
    first, second = (Trajectory([SE3.from_matrix(pose) for pose in p], list(time)) for p in (path, goal))
    aligned, similarity = align_trajectory(first, second, ret_params=True)
    found = np.array([pose.as_matrix() for pose in aligned.get_elements()])
    rotation, _ = Rotation.align_vectors(goal[:, :3, 3] - goal[:, :3, 3].mean(0),
                                         path[:, :3, 3] - path[:, :3, 3].mean(0))
    assert np.allclose(rotation.as_matrix(), motion[:3, :3], atol=1e-6)
    error = np.abs(found - goal).max(axis=0)
    return np.linalg.det(similarity.R().as_matrix()), error[:3, 3].max(), error[:3, :3].max()


ok = True
for name, height in (("in a plane", 0.0), ("with slopes", 0.5)):
    random, rows = np.random.default_rng(0), []
    for _ in range(COUNT):
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
        rows.append(align(poses(height), motion))
    determinant, position, rotation = np.array(rows).T
    mirrored = determinant < 0.0
    print(f"a path {name}: aligned by a reflection in {mirrored.sum()} of {COUNT} frames; positions are off by up to"
          f" {position.max():.1e} m, elements of rotation matrices by up to {rotation.max():.2f}")
    ok &= np.allclose(np.abs(determinant), 1.0) and position.max() < 1e-9
    ok &= mirrored.sum() > 20 and rotation[mirrored].min() > 0.5 if height == 0.0 else not mirrored.any()
    ok &= rotation[~mirrored].max() < 1e-6
sys.exit(not ok)
PY
