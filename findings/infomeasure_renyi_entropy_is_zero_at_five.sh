#!/usr/bin/env bash
# infomeasure 0.6.3: `entropy(x, approach="renyi", alpha=...)` estimates the Renyi entropy of samples from the distances
# to their neighbours of rank k, 4 by default. The documentation asks for an alpha above 0. The estimator exists for
# alpha below k + 1 alone, and degrades on the way there. At k + 1, the library returns 0, whatever the samples: narrow
# or wide, any dimension. The mutual information of a variable with its noisy copy is 0 too, which reads as
# independence. Nothing warns. Beyond k + 1, the result is nan. The Tsallis entropy, `approach="tsallis"`, has the same.
# Law: ten times wider samples have an entropy higher by ln 10. That of a normal variable has a closed form.
# Upstream: no issue of github.com/cbueth/infomeasure that was found describes it.
# Give a k of twice alpha: for alpha = 5, k = 10 is off by 0.01 here.
# Prints both for alpha = 2 to 5.5, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'infomeasure==0.6.3' 'numpy==2.4.6' 'scipy==1.17.1' \
  'numba==0.68.1' 'llvmlite==0.50.0' 'sparse==0.19.3'
cd "$folder"
"$folder/venv/bin/python" -W ignore::RuntimeWarning - <<'PY'
import sys

import infomeasure
import numpy as np

rng = np.random.default_rng(1)
x = rng.standard_normal(4000)
copy = 0.9 * x + np.sqrt(1.0 - 0.9**2) * rng.standard_normal(4000)  # a correlation of 0.9 with x
found = {}
for alpha in (2.0, 3.0, 4.0, 4.5, 4.9, 5.0, 5.5):
    true = 0.5 * np.log(2.0 * np.pi) + 0.5 * np.log(alpha) / (alpha - 1.0)
    narrow, wide, more = (float(infomeasure.entropy(scale * x, approach="renyi", alpha=alpha, **options))
                          for scale, options in ((1.0, {}), (10.0, {}), (1.0, {"k": 10})))
    shared = float(infomeasure.mutual_information(x, copy, approach="renyi", alpha=alpha))
    tsallis = float(infomeasure.entropy(x, approach="tsallis", q=alpha))
    found[alpha] = true, narrow, wide, more, shared, tsallis
    print(f"alpha = {alpha}: true {true:.3f}, by the library {narrow:.3f}, with k = 10 {more:.3f}; ten times wider"
          f" true {true + np.log(10.0):.3f}, by the library {wide:.3f}; mutual information {shared:.3f};"
          f" Tsallis true {(1.0 - np.exp((1.0 - alpha) * true)) / (alpha - 1.0):.3f}, by the library {tsallis:.3f}")
ok = all(abs(found[alpha][1] - found[alpha][0]) < 0.05 for alpha in (2.0, 3.0)) and found[4.9][1] > found[4.9][0] + 0.3
ok &= all(abs(wide - narrow - np.log(10.0)) < 1e-6 for alpha, (_, narrow, wide, *_) in found.items() if alpha < 5.0)
ok &= all(abs(more - true) < 0.1 for true, _, _, more, *_ in found.values())
ok &= found[5.0][1:3] == (0.0, 0.0) and found[5.0][4:] == (0.0, 0.0) and found[4.0][4] > 0.5
ok &= bool(np.isnan(found[5.5][1:3] + found[5.5][4:]).all())
ok &= all(infomeasure.entropy(rng.standard_normal((500, m)), approach="renyi", alpha=5) == 0 for m in (2, 3))
sys.exit(not ok)
PY
