#!/usr/bin/env bash
# Robotics Toolbox 1.5.0: `ParticleFilter` resamples with the wrong weights. It draws a number between 0 and 1, and
# takes the particle whose cumulated weight is nearest, in place of the first that is not below it. So a particle is
# drawn by the mean of its own weight and that of the next in the array. With two hypotheses of the pose in alternating
# rows, an observation cannot tell them apart: the wrong one has 4.5 % of the weight, and gets half of the particles. In
# rows that are sorted by hypothesis, it gets its share. The order of particles must not matter.
# From uniform particles, half of the copies of a good one are of its neighbour, which may be anywhere.
# Upstream: no issue of github.com/petercorke/robotics-toolbox-python that was found describes it.
# Prints the weight and the share of the wrong hypothesis after one observation, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'roboticstoolbox-python==1.5.0' \
  'spatialmath-python==1.1.18' 'numpy==2.4.6' 'scipy==1.17.1' 'matplotlib==3.11.2'
cd "$folder"
MPLBACKEND=agg "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from roboticstoolbox import LandmarkMap, ParticleFilter, RangeBearingSensor, Unicycle

N = 10000
TRUE, WRONG = (0.0, 0.0, 0.0), (2.0, 0.0, 0.0)
NOISE, ERROR = np.diag([1e-6, 1e-6, 1e-6]) ** 2, np.diag([0.1, 0.1]) ** 2  # of motion and of range and bearing
orders = {
    "sorted": np.repeat([TRUE, WRONG], N // 2, axis=0),
    "alternating": np.tile([TRUE, WRONG], (N // 2, 1)),
}
shares = {}
for name, particles in orders.items():
    robot = Unicycle(x0=TRUE)
    robot.control = (0.0, 0.0)  # stands
    sensor = RangeBearingSensor(robot, LandmarkMap(np.array([[3.0], [1.0]]), workspace=10))
    pf = ParticleFilter(robot, sensor, R=NOISE, L=ERROR, nparticles=N, x0=particles, workspace=10, animate=False)
    pf.run(T=robot.dt)  # one step, with one observation of the landmark
    weight = pf.history[0].weights[particles[:, 0] > 1.0].sum() / pf.history[0].weights.sum()
    shares[name] = weight, np.mean(pf.x[:, 0] > 1.0)
    print(f"{name}: the wrong hypothesis has {100 * weight:.1f} % of the weight and gets {100 * shares[name][1]:.1f} %",
          f"of the particles; mean x {pf.get_xyt()[0, 0]:.3f} m, deviation {pf.get_std()[0, 0]:.3f} m")
(weight, fair), (same, unfair) = shares.values()
sys.exit(not (abs(weight - same) < 1e-6 and abs(fair - weight) < 0.02 and abs(unfair - 0.5) < 0.02))
PY
