#!/usr/bin/env bash
# quat-numpy 0.2.0: `signal.qconv(x, kernel)` is documented as a convolution of quaternions, as to smooth orientations
# with the kernels of `signal.lowpass`. It multiplies Fourier transforms of pairs of components, as if the theorem of
# convolution held for them. It does not, since quaternions do not commute. Nothing warns. Even for a kernel of real
# numbers, only the first two components are convolved. The other two are convolved with the kernel in reverse time,
# so what should come after an impulse comes before it. A moving average over the past thus looks into the future for
# half of the components.
# Prints the convolution of an impulse, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'quat-numpy==0.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from quat.signal import qconv

signal, kernel = np.zeros((8, 4)), np.zeros((3, 4))
signal[3] = 1.0, 2.0, 3.0, 4.0  # an impulse
kernel[:, 0] = 1.0, 10.0, 100.0  # real numbers, so the order of the factors does not matter
found = qconv(signal, kernel)
truth = np.array([np.convolve(component, kernel[:, 0]) for component in signal.T]).T
reverse = np.array([np.correlate(component, kernel[:, 0], "full") for component in signal.T]).T
for name, row in (("by definition", truth), ("qconv", found)):
    print(f"{name}: first component {row[:, 0].round(6) + 0.0}, third {row[:, 2].round(6) + 0.0}")
forwards = np.abs(found[:, :2] - truth[:, :2]).max()
backwards = np.abs(found[:-2, 2:] - reverse[2:, 2:]).max()  # from the impulse on, to the past
print(f"largest error of the components 1 and 2: {forwards:.0e}, of 3 and 4: {np.abs(found - truth)[:, 2:].max():.0f}")
sys.exit(not (forwards < 1e-9 > backwards and np.abs(found - truth)[:, 2:].max() > 100.0))
PY
