#!/usr/bin/env bash
# wmm-calculator 1.4.4, the module of NOAA for the World Magnetic Model: `get_uncertainty()` returns the uncertainty
# of each element of the field. For the declination, the error model that the documentation names is sqrt(0.26^2 +
# (5417 nT / H)^2) degrees, with the horizontal intensity H. The package has both numbers, and uses one of them: it
# divides 0.26 by H, and rounds 0.26 down to 0. Nothing warns. So the declination seems to be known to some millionths
# of a degree. Its true uncertainty is 0.3 degrees or more, and above one degree near a magnetic pole. A filter that
# takes a compass by it trusts the map of the field without limit.
# Prints uncertainties at four places, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'wmm-calculator==1.4.4' 'geomaglib==1.2.4' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from wmm import wmm_calc
from wmm.uncertainty import err_model

assert (err_model["D_OFFSET"], err_model["D_COEF"]) == (0.26, 5417)  # of the World Magnetic Model of 2025
PLACES = ("Zurich", 47.4, 8.5), ("Singapore", 1.3, 103.8), ("Resolute", 74.7, -94.8), ("Hobart", -42.9, 147.3)
ok = True
for place, lat, lon in PLACES:
    model = wmm_calc()
    model.setup_time(dyear=2026.0)
    model.setup_env(lat, lon, 0.0)
    H = float(np.squeeze(model.get_all()["h"]))
    found = float(np.squeeze(model.get_uncertainty()["declination_uncertainty"]))
    truth = float(np.hypot(0.26, 5417.0 / H))
    print(f"{place}: H {H:.0f} nT, uncertainty of the declination {found:.1e} degrees, by the error model {truth:.2f}")
    ok &= abs(found - 0.26 / H) < 1e-12 and truth > 1000.0 * found
sys.exit(not ok)
PY
