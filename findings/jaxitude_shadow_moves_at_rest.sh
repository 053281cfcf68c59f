#!/usr/bin/env bash
# JAXitude 1.0.0: `evolve_MRP_shadow(s, w)` takes modified Rodrigues parameters s and body rates w. It is documented to
# return ds/dt of the shadow set, -s / (s . s), which stands for the same attitude. For the first of its two terms, it
# calls `evolve_MRP(w, s)` in place of `evolve_MRP(s, w)`. Nothing warns. So the shadow of an attitude of 170 degrees
# moves though the body is at rest, as if it turned at half a radian per second. In a turn, the rate misses by more than
# its own size, and is no longer linear in w.
# Law: the derivative of the library's own `shadow` along `evolve_MRP`, which SciPy 1.17.1 confirms; it is zero at rest.
# Upstream: no issue of github.com/jhand1993/jaxitude that was found describes it.
# `evolve_MRP(shadow(s), w)` is right.
# Prints the error for some rates, beside the one of the workaround, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'jaxitude==1.0.0' 'jax==0.10.2' 'jaxlib==0.10.2' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
JAX_PLATFORMS=cpu JAX_ENABLE_X64=1 "$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from jaxitude.rodrigues import evolve_MRP, evolve_MRP_shadow, shadow
from scipy.spatial.transform import Rotation

print("JAXitude", version("jaxitude"))
STEP = 1e-6  # s
AXIS, ABOUT = np.array((2.0, -1.0, 2.0)) / 3.0, np.array((1.0, 2.0, 2.0)) / 3.0
ok = True
for degrees in (170.0, 185.0):
    s = np.tan(np.radians(degrees) / 4.0) * AXIS
    column = jnp.asarray(s)[:, None]
    found = {}
    for rate in (0.1, 1.0, 2.0, 10.0):
        w = jnp.asarray(rate * ABOUT)[:, None]
        true = np.asarray(jax.jvp(shadow, (column,), (evolve_MRP(column, w),))[1])
        # The same by SciPy: the shadow of small turns before and after.
        ends = [(Rotation.from_mrp(s) * Rotation.from_rotvec(t * rate * ABOUT)).as_mrp() for t in (-STEP, STEP)]
        ends = [end if np.dot(end, s) < 0.0 else -end / np.dot(end, end) for end in ends]
        by_scipy = (ends[1] - ends[0])[:, None] / (2.0 * STEP)
        by_library = np.asarray(evolve_MRP_shadow(column, w))
        by_other = np.asarray(evolve_MRP(shadow(column), w))
        error, right, reference = (float(np.linalg.norm(a - true) / np.linalg.norm(true))
                                   for a in (by_library, by_other, by_scipy))
        found[rate] = error, np.linalg.norm(by_library), np.linalg.norm(true)
        print(f"attitude of {degrees:g} degrees, {rate:g} rad/s: relative error {error:.3f}; evolve_MRP of the shadow"
              f" {right:.1e}; SciPy {reference:.1e}")
        ok &= right < 1e-12 and reference < 1e-6 and error > 1.0
    ok &= abs(found[2.0][1] / found[1.0][1] - 2.0) > 0.1 and abs(found[2.0][2] / found[1.0][2] - 2.0) < 1e-9
    still = np.asarray(evolve_MRP_shadow(column, jnp.zeros((3, 1))))
    print(f"attitude of {degrees:g} degrees at rest: the shadow moves by {np.linalg.norm(still):.3f}/s")
    ok &= float(np.linalg.norm(still)) > 0.1
sys.exit(not ok)
PY
