#!/usr/bin/env bash
# allan-variance-analyzer 1.0.4: `compute_allan_variances(data, periods, measure_rate, overlap)` averages over bins that
# may overlap, by half of their length if `overlap` has its default of 0.5. The Allan variance compares averages of
# neighbouring bins, one period apart. The library makes a count of samples of the overlap, and takes the count for a
# share. So any overlap shifts the bins by one sample, and the averages that are compared share all but one sample
# each. Nothing warns. White noise falls with the period, in place of its square root, and looks like quantization.
# For bins of 1000 samples, the Allan deviation is 32 times too small.
# Law: overlapping bins estimate the same variance as separate ones. White noise with a deviation of s per sample has
# the Allan deviation s / sqrt(n) over n samples (IEEE Std 952, equation of the angle random walk). AllanTools 2024.6
# finds it with overlapping bins.
# Upstream: no issue of github.com/varunagrawal/allan_variance that was found describes it.
# `overlap=0`, the default of `AllanVarianceAnalyzer`, is right.
# Prints the deviations by the overlap, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'matplotlib==3.11.2' 'loguru==0.7.3' 'pyyaml==6.0.4' 'tqdm==4.70.1'
"${pip[@]}" --no-deps 'allan-variance-analyzer==1.0.4' 'AllanTools==2024.6'
cd "$folder"
"$folder/venv/bin/python" - 2>errors <<'PY' || { tail errors; exit 1; }
import sys
from importlib.metadata import version

import allantools
import numpy as np
from allan_variance_analyzer.statistics import compute_allan_variances

RATE = 100  # Hz
PERIODS = np.array((0.1, 0.5, 1.0, 2.0, 5.0, 10.0))  # s
OVERLAPS = 0.0, 0.25, 0.5, 0.75
print("allan-variance-analyzer", version("allan-variance-analyzer"))
data = np.random.default_rng(0).normal(size=(200_000, 6))
true = 1.0 / np.sqrt(PERIODS * RATE)
_, peer, _, _ = allantools.oadev(data[:, 0], rate=RATE, data_type="freq", taus=PERIODS)
found = {o: np.sqrt(compute_allan_variances(data, PERIODS, RATE, o)).mean(axis=1) for o in OVERLAPS}
default = np.sqrt(compute_allan_variances(data, PERIODS, RATE)).mean(axis=1)
for i, period in enumerate(PERIODS):
    print(f"{period:g} s: true {true[i]:.4f}, AllanTools {peer[i]:.4f}; by overlap",
          ", ".join(f"{o:g}: {found[o][i]:.4f}" for o in OVERLAPS))
slopes = {o: np.polyfit(np.log(PERIODS), np.log(found[o]), 1)[0] for o in OVERLAPS}
print("slopes by overlap:", ", ".join(f"{o:g}: {slopes[o]:.2f}" for o in OVERLAPS))
ok = np.allclose(found[0.0], true, rtol=0.2) and np.allclose(peer, true, rtol=0.2)
ok &= np.array_equal(default, found[0.5]) and np.allclose(found[0.75], found[0.25])
sys.exit(not (ok and abs(slopes[0.0] + 0.5) < 0.1 and abs(slopes[0.5] + 1.0) < 0.05))
PY
