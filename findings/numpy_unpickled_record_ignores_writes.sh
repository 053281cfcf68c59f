#!/usr/bin/env bash
# NumPy 2.4.6: an element of a structured array is a record whose fields can be written. A pickled record has the same
# values and the same type, and says that it is writeable. But whatever is written to a field is gone: the value stays
# as it was, and no error tells it. A filter's state that is kept as a record stands still in another process.
# A copy by `copy.deepcopy`, and a pickled array of one record, keep what is written.
# Upstream: no issue of github.com/numpy/numpy that was found describes it.
# Prints the field after a write to each kind of copy, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import copy
import pickle
import sys

import numpy as np

array = np.zeros(1, [("time", "f8"), ("pose", "f8", 3)])
copies = {
    "pickled record": pickle.loads(pickle.dumps(array[0])),
    "deep copy": copy.deepcopy(array[0]),
    "record of a pickled array": pickle.loads(pickle.dumps(array))[0],
}
seen = {}
for name, record in copies.items():
    assert record.flags.writeable and record.dtype == array.dtype
    record["time"] = 5.0
    seen[name] = float(record["time"])
print(f"NumPy {np.__version__}, after a write of 5.0: {seen}")
sys.exit(list(seen.values()) != [0.0, 5.0, 5.0])
PY
