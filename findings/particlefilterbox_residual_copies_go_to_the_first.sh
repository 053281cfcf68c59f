#!/usr/bin/env bash
# particlefilterbox 0.1.0: `residual_resample(weights)` of N particles makes floor(N w) copies of each particle first.
# The M slots that are left are to be drawn by the remainders N w - floor(N w). The library draws N in place of M, by a
# method that returns indices in ascending order, and keeps the first M. Nothing warns. So the particles that stand
# first in the array get all of them. If the first half has weights of 0.5 / N, and the second of 1.5 / N, each particle
# gets one copy: the weights have no effect. The mean of 1000 sorted particles is off by 0.4 standard deviations of the
# posterior, and to the other side in the reverse order.
# Law: a particle has N w copies on average. The order of the particles must not matter. The library's other methods
# obey both.
# Upstream: no issue of github.com/nodesecon/particlefilterbox that was found describes it.
# `systematic_resample`, the default, is right. The mean error is less where particles and weights are shuffled.
# Prints copies and means by all methods, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'particlefilterbox==0.1.0' 'numpy==2.4.6' \
  'scipy==1.17.1' 'pandas==3.1.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from particlefilterbox.resampling import get_resampling_fn

N, RUNS = 1000, 100
HALVES = np.repeat((0.5, 1.5), N // 2) / N
random = np.random.default_rng(0)
ok = True
particles = np.sort(random.normal(0.0, 3.0, N))
weights = np.exp(-0.5 * (2.0 - particles) ** 2)  # a measurement of 2 with the deviation 1
weights /= weights.sum()
mean = weights @ particles
deviation = np.sqrt(weights @ (particles - mean) ** 2)
print(f"posterior of the weighted particles: mean {mean:.3f}, standard deviation {deviation:.3f}")
orders = {"ascending": np.arange(N), "descending": np.arange(N)[::-1]}
for method in ("multinomial", "stratified", "systematic", "residual"):
    resample = get_resampling_fn(method)
    copies = [(resample(HALVES, random) < N // 2).sum() for _ in range(RUNS)]
    means = [np.mean([particles[order][resample(weights[order], random)].mean() for _ in range(RUNS)])
             for order in orders.values()]
    print(f"{method}: copies of the first half {np.mean(copies):.0f} of {N}, due {N // 4}; mean of ascending particles"
          f" {means[0]:.3f}, of descending ones {means[1]:.3f}")
    off = (np.array(means) - mean) / deviation
    if method == "residual":
        ok &= copies == [N // 2] * RUNS and off[0] < -0.3 and off[1] > 0.3
    else:
        ok &= np.isclose(np.mean(copies), N // 4, atol=6.0) and np.abs(off).max() < 0.02
sys.exit(not ok)
PY
