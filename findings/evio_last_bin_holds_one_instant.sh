#!/usr/bin/env bash
# evio 0.1.0: `binary_tensor(events, bins)` has "one bit per pixel per time bin", to feed a spiking network. The library
# maps the times of the events to 0 ... bins - 1, where the last event alone reaches the end, and rounds down. So the
# recording is cut into bins - 1 parts. The last bin holds the events of its last microsecond, mostly one. Nothing
# warns. With two bins, the first has all the recording. With 10, a network gets nine steps of 1.11 times the length,
# and an empty one.
# Law: equal bins of a recording with a constant rate hold equally many events. The recording played backwards fills the
# bins backwards. `numpy.histogram` of NumPy 2.4.6 makes such bins.
# The voxel grid, which interpolates between the bins, is meant to reach from 0 to bins - 1.
# Prints the number of pixels that fired in each bin, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'evio==0.1.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import evio
import numpy as np

SIZE, LENGTH = (100, 100), 1_000_000  # pixels, microseconds
print("evio", evio.__version__)
pixels = np.random.default_rng(0).permutation(SIZE[0] * SIZE[1])  # each fires once, at a constant rate
times = np.linspace(0, LENGTH, len(pixels)).astype(int)


def fired(order, t, bins):
    """Pixels that fired in each bin."""
    events = evio.from_arrays(order % SIZE[0], order // SIZE[0], t, np.ones(len(order)))
    return evio.binary_tensor(events, bins, sensor_size=SIZE).sum(axis=(1, 2, 3))


ok = True
for bins in (2, 5, 10):
    found, backwards = fired(pixels, times, bins), fired(pixels[::-1], LENGTH - times[::-1], bins)
    expected = np.histogram(times, bins)[0]
    print(f"{bins} bins: {found.tolist()}, backwards {backwards[::-1].tolist()}, by NumPy {expected.tolist()}")
    ok &= found[-1] == 1 and found.sum() == len(pixels) and backwards[-1] == 1 and np.ptp(expected) <= 1
    ok &= np.ptp(found[:-1]) <= 2
sys.exit(not ok)
PY
