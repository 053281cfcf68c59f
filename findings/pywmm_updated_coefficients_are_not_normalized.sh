#!/usr/bin/env bash
# pywmm 1.1.1: `WMMv2.update_coefficients(new_coeff_file=...)` is documented to take new coefficients of the World
# Magnetic Model without a new object. A new object reads the file, and multiplies all coefficients by the factors of
# Schmidt's normalization. The update reads the file alone, and returns True. Nothing warns. So the update with the
# very file that the object has changes the field: in Zurich, the declination goes from 3.5 to 1.3 degrees, and the
# horizontal field grows by 8 %. A compass that uses it points elsewhere from then on.
# Prints the field before and after the update, and of a new object, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pywmm==1.1.1' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import pathlib
import sys

import pywmm
from pywmm import WMMv2

PLACE = 47.4, 8.5, 2026.0, 0.0  # latitude, longitude, year and height
file = str(pathlib.Path(pywmm.__file__).parent / "data" / "WMM.COF")


def field(model):
    return model.get_declination(*PLACE), float(model.get_horizontal_intensity(*PLACE)), model.get_intensity(*PLACE)


model = WMMv2()
before = field(model)
updated = model.update_coefficients(new_coeff_file=file)
after, new = field(model), field(WMMv2(coeff_file=file))
for name, (declination, horizontal, total) in (("before", before), ("after", after), ("new object", new)):
    print(f"{name}: declination {declination:.3f} degrees, horizontal {horizontal:.1f} nT, total {total:.1f} nT")
g = next(float(words[2]) for words in map(str.split, open(file)) if words[:2] == ["2", "0"])
print(f"the update returns {updated}; g(2, 0) is {g} in the file, {float(model.c[0][2])} after the update, and",
      f"{float(WMMv2(coeff_file=file).c[0][2]):.2f} in the new object, 1.5 times as large")
sys.exit(not (updated and before == new and abs(after[0] - before[0]) > 1.0 and after[1] > 1.05 * before[1]))
PY
