#!/usr/bin/env bash
# cnspy-trajectory 0.2.14: `TrajectoryEstimated.transform(p_GN_in_G=..., R_GN=...)` moves a trajectory to another world,
# with the covariances of its positions and orientations. Where both errors are global (type6 of the package's formats),
# the library turns both covariances, and stores that of the orientation in the place of the position's too. Nothing
# warns. So a deviation of 0.5 m becomes one of 0.02 m, which is that of the heading in radians. The covariance of the
# orientation stays unturned.
# The identity, no move at all, does the same. Where the orientation's error is local (type5), positions are right.
# Law: a covariance is turned by the rotation of its frame on both sides, and the identity changes nothing.
# Prints the deviations before and after moves, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'cnspy-trajectory==0.2.14' \
  'cnspy-spatial-csv-formats==0.2.2' 'cnspy-csv2dataframe==0.2.3' 'cnspy-timestamp-association==0.2.1' \
  'spatialmath-python==1.1.18' 'numpy==2.4.6' 'scipy==1.17.1' 'pandas==3.1.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from cnspy_spatial_csv_formats.EstimationErrorType import EstimationErrorType
from cnspy_trajectory.TrajectoryEstimated import TrajectoryEstimated
from scipy.spatial.transform import Rotation

POSITION, ORIENTATION = np.diag((0.5, 0.1, 0.3)) ** 2, np.diag((0.01, 0.03, 0.02)) ** 2
ok = True
for kind in ("type6", "type5"):
    for degrees in (0.0, 90.0, 30.0):
        path = TrajectoryEstimated(
            t_vec=np.arange(3.0), p_vec=np.arange(9.0).reshape(3, 3), q_vec=np.tile((0.0, 0.0, 0.0, 1.0), (3, 1)),
            Sigma_p_vec=np.tile(POSITION, (3, 1, 1)), Sigma_R_vec=np.tile(ORIENTATION, (3, 1, 1)))
        path.format.estimation_error_type = EstimationErrorType(kind)
        R = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
        path.transform(p_GN_in_G=np.array((5.0, 0.0, 0.0)), R_GN=R)
        right, wrong = R @ POSITION @ R.T, R @ ORIENTATION @ R.T
        found = path.Sigma_p_vec[1]
        print(f"{kind}, turned by {degrees:g} degrees: deviations of the position {np.sqrt(np.diag(found)).round(4)} m,"
              f" truly {np.sqrt(np.diag(right)).round(4)} m; of the orientation"
              f" {np.sqrt(np.diag(path.Sigma_R_vec[1])).round(4)} rad, turned {np.sqrt(np.diag(wrong)).round(4)} rad")
        ok &= bool(np.allclose(found, wrong if kind == "type6" else right))
        ok &= bool(np.allclose(path.Sigma_R_vec, ORIENTATION))
        ok &= bool(np.allclose(path.p_vec, np.arange(9.0).reshape(3, 3) @ R.T + (5.0, 0.0, 0.0)))
sys.exit(not ok)
PY
