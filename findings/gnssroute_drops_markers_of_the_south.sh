#!/usr/bin/env bash
# gnssroute 0.1.1: `read_mrk` reads the markers of a DJI drone, one line for each photo, with the RTK position of the
# camera. Lines with a negative latitude, longitude or height are left out. So a flight in Australia, Brazil or the
# United States has no markers, and one across the meridian of Greenwich has a part of them. Nothing warns. The pipeline
# then returns the uncorrected route as the optimised one.
# The expression `_LINE_RE` in io/mrk.py takes a sign for the offsets N, E and V, and none for Lat, Lon and Ellh. What
# does not match is skipped.
# Law: a line is a waypoint, wherever it lies. The markers of a route, mirrored at the equator or at the meridian, are
# the mirrored markers. With markers, the optimised route passes through them.
# Upstream: no issue of github.com/Jia-SH/dji-gnssroute that was found describes it.
# `read_waypoints_csv` takes signs.
# Prints the waypoints of five flights, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gnssroute==0.1.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from pathlib import Path

from gnssroute.io.csv_io import read_waypoints_csv
from gnssroute.io.mrk import read_mrk
from gnssroute.pipeline import run_steps

COUNT = 10
ok = True
for name, lat, lon, height, kept in (
        ("Hangzhou", 30.25, 120.17, 35.0, COUNT), ("Sydney", -33.87, 151.21, 35.0, 0),
        ("Denver", 39.74, -104.99, 1600.0, 0), ("below the ellipsoid", 30.25, 120.17, -12.0, 0),
        ("across Greenwich", 51.48, -0.00045, 80.0, COUNT // 2)):
    true = [(200000.0 + i, lat + 1e-4 * i, lon + 1e-4 * i, height) for i in range(COUNT)]
    Path("flight.MRK").write_text("".join(
        f"{i + 1}\t{t:.6f}\t[2300]\t   -12,N\t     7,E\t    95,V\t{y:.8f},Lat\t{x:.8f},Lon\t{h:.3f},Ellh\t"
        f"0.010000, 0.010000, 0.020000\t50,Q\n" for i, (t, y, x, h) in enumerate(true)))
    Path("markers.csv").write_text("t,lat,lon,height\n" + "".join(f"{t},{y},{x},{h}\n" for t, y, x, h in true))
    Path("route.csv").write_text("t,lat,lon,height\n" + "".join(f"{t},{y},{x},{h + 3.0}\n" for t, y, x, h in true))
    files = {"trajectory_csv": "route.csv", "mrk_path": "flight.MRK"}
    result = run_steps({"input": files, "optimize": {"enabled": True}})
    errors = [abs(p.height - h) for p, (_, _, _, h) in zip(result["final"].points, true)]
    found, by_csv = len(read_mrk("flight.MRK")), len(read_waypoints_csv("markers.csv"))
    print(f"{name}: {found} of {COUNT} markers, from a CSV file {by_csv}; the optimised route is off by"
          f" {max(errors):.3f} m in height, the route by 3.000 m")
    ok &= found == kept and by_csv == COUNT and (max(errors) < 1e-3 if kept == COUNT else True)
    ok &= abs(max(errors) - 3.0) < 1e-6 if kept == 0 else True
sys.exit(not ok)
PY
