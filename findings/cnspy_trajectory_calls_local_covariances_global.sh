#!/usr/bin/env bash
# cnspy-trajectory 0.2.14: `TrajectoryEstimated.convert_to_global_covariance()` converts covariances of errors in the
# axes of the body to those of the world. Where the error of the position is global already and that of the orientation
# is local (type5), the library turns the covariance of the orientation, and then stores the one that it had before. The
# trajectory is marked as global (type6). Nothing warns. So a robot that looks to the left has its uncertain roll in
# the place of its pitch: the variances of x and y are exchanged, and no later call can repair it.
# Law: by the package's own formats, R_true = R exp(local) = exp(global) R, so the global covariance is that of the
# local one with R on both sides. Samples have it.
# Prints deviations by the library and by samples, and fails if that changes.
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

POSITION, LOCAL = np.diag((0.5, 0.1, 0.3)) ** 2, np.diag((0.04, 0.01, 0.02)) ** 2
rng = np.random.default_rng(0)
ok = True
for degrees in (0.0, 30.0, 90.0):
    R = Rotation.from_euler("z", degrees, degrees=True)
    path = TrajectoryEstimated(
        t_vec=np.arange(2.0), p_vec=np.zeros((2, 3)), q_vec=np.tile(R.as_quat(), (2, 1)),
        Sigma_p_vec=np.tile(POSITION, (2, 1, 1)), Sigma_R_vec=np.tile(LOCAL, (2, 1, 1)))
    path.format.estimation_error_type = EstimationErrorType.type5
    path.convert_to_global_covariance()
    errors = R * Rotation.from_rotvec(rng.multivariate_normal(np.zeros(3), LOCAL, 20000)) * R.inv()
    found, true = path.Sigma_R_vec[1], R.as_matrix() @ LOCAL @ R.as_matrix().T
    print(f"heading {degrees:g} degrees: marked as {path.format.estimation_error_type}, deviations of the orientation"
          f" {np.sqrt(np.diag(found)).round(4)} rad; truly {np.sqrt(np.diag(true)).round(4)}, of samples"
          f" {errors.as_rotvec().std(axis=0).round(4)}")
    ok &= path.format.estimation_error_type == EstimationErrorType.type6 and bool(np.allclose(found, LOCAL))
    ok &= bool(np.allclose(np.cov(errors.as_rotvec().T), true, atol=5e-5))
    ok &= bool(np.allclose(found, true)) == (degrees == 0.0)
sys.exit(not ok)
PY
