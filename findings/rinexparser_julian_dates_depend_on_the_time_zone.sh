#!/usr/bin/env bash
# RinexParser 1.2.4: `timescale.ts2jd(timestamp)` converts "UNIX timestamp to Julian datetime", and `ts2mjd` to the
# modified Julian date. Both count in universal time, so time zones have no part in it. The library converts the stamp
# to the time of day of the computer's time zone first. Nothing warns. So one stamp has as many Julian dates as there
# are time zones: in Los Angeles, it is 8 hours too early. Right dates come where the clock shows universal time, as
# in most containers.
# Prints Julian dates of 1970-01-01 in three time zones, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'RinexParser==1.2.4'
cd "$folder"
cat >dates.py <<'PY'
import os
import sys
import time

from rinex_parser.timescale import ts2jd, ts2mjd

found = {}
for zone, hours in (("UTC0", 0), ("PST8", -8), ("JST-9", 9)):
    os.environ["TZ"] = zone
    time.tzset()
    found[hours] = [(ts2jd(stamp) - (2440587.5 + stamp / 86400.0)) * 24.0 for stamp in (0.0, 1.7e9)]
    print(f"{zone}: 1970-01-01 00:00 UTC is JD {ts2jd(0.0):.5f} and MJD {ts2mjd(0.0):.5f}; true: 2440587.5, 40587;",
          f"errors {[round(error, 3) for error in found[hours]]} hours")
sys.exit(not all(abs(error - hours) < 1e-3 for hours, errors in found.items() for error in errors))
PY
"$folder/venv/bin/python" dates.py
