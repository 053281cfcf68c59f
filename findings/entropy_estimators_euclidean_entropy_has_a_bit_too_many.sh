#!/usr/bin/env bash
# entropy_estimators 0.0.2: `get_h(x, norm="euclidean")` estimates the entropy by the distances of neighbours, as
# Kozachenko and Leonenko. The logarithm of twice the distance goes with the volume of a ball whose *diameter* is 1. The
# library takes the volume of the ball whose radius is 1. It is 2^d times as large in d dimensions. Nothing warns. So
# each dimension adds a bit to the entropy, 0.69 nats. With `norm="max"`, the default, the volume is right.
# Law: in one dimension, both norms are the absolute value, so both estimates are one. The entropy of a normal
# distribution is d / 2 log(2 pi e) nats.
# Textbook: Kraskov, Stoegbauer, Grassberger, Physical Review E 69, 066138, section II A: the volume of the
# Euclidean ball is pi^(d/2) / Gamma(1 + d/2) / 2^d.
# Upstream: the closed issue github.com/paulbrodersen/entropy_estimators/issues/14 asks for the factor 2. It does not
# tell that the volume does not fit it.
# Mutual information by `estimator="naive"` is right, as the bits cancel.
# Prints the estimates and the truth, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'entropy_estimators==0.0.2' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from entropy_estimators.continuous import get_h

print("entropy_estimators", version("entropy_estimators"))
random = np.random.default_rng(0)
ok = True
for dimensions in (1, 2, 3, 6):
    x = random.normal(size=(5000, dimensions))
    true = 0.5 * dimensions * np.log(2.0 * np.pi * np.e)
    by_max, euclidean = (get_h(x, k=3, norm=norm) for norm in ("max", "euclidean"))
    excess = (euclidean - true) / np.log(2.0)
    print(f"{dimensions} dimensions: {true:.3f} nats, by the maximum norm {by_max:.3f}, by the Euclidean norm"
          f" {euclidean:.3f}, which is {excess:.2f} bits too many")
    ok &= abs(excess - dimensions) < 0.15 and abs(by_max - true) < 0.2
    if dimensions == 1:
        ok &= bool(np.isclose(euclidean - by_max, np.log(2.0)))
sys.exit(not ok)
PY
