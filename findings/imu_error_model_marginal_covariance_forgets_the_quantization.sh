#!/usr/bin/env bash
# imu-error-model 0.1.3: `characterize_imu_error_process` returns covariances of an inertial sensor's increments for a
# filter. The conditional one is for a known bias at the start, and the marginal one includes the uncertainty of the
# bias. With `include_quantization_approximation=True`, the conditional covariance has the quantization of the readings,
# by its step squared over twelve. The marginal one does not change. Nothing warns, and its metadata say that
# quantization uses the approximation. So knowledge of the bias makes the increments less certain. A filter that takes
# the marginal covariance is overconfident.
# Law: the marginal covariance is the conditional one plus that of the conditional mean, so it is never less. Increments
# of 4000 sensors by the library's own `ImuModel` have the covariance that the law gives.
# Upstream: the package names no repository; no report of it was found.
# Add the difference that the option makes to `conditional_increment_covariance` to the marginal one.
# Prints standard deviations without and with quantization, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'imu-error-model==0.1.3' 'numpy==2.4.6' \
  'pydantic==2.14.4'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from imu_error_model import AxisConfig, ImuConfig, ImuModel, characterize_imu_error_process

PERIOD, STEP = 0.01, 0.02  # s, m/s^2 or rad/s


def deviations(quantized):
    """Deviations of an increment: conditional and marginal by the library, by the law, and of simulated sensors."""
    axes = AxisConfig(white_noise_density=0.5 * STEP * np.sqrt(PERIOD), turn_on_bias_std=0.2 * STEP,
                      quantization_step=STEP if quantized else None)
    config = ImuConfig(accelerometer=axes, gyroscope=axes)
    found = characterize_imu_error_process(config, dt=PERIOD, include_quantization_approximation=quantized)
    conditional, marginal = found.conditional_increment_covariance, found.marginal_increment_covariance
    bias = PERIOD**2 * found.accelerometer.persistent.prior_bias_covariance
    assert not found.accelerometer.persistent.process_covariance.any()  # a bias that is constant
    increments = []
    for seed in range(4000):
        model = ImuModel(config, np.random.default_rng(seed))
        model.measure(0.0, np.zeros(3), np.eye(3))
        increments.append(model.measure(PERIOD, np.zeros(3), np.eye(3)).delta_v)
    variances = conditional[0, 0], marginal[0, 0], (conditional[:3, :3] + bias)[0, 0], np.mean(np.square(increments))
    return np.sqrt(variances) / (PERIOD * STEP), found.metadata


ok = True
for quantized in (False, True):
    (conditional, marginal, law, simulated), metadata = deviations(quantized)
    print(f"{'with' if quantized else 'without'} quantization: conditional {conditional:.3f} steps, marginal"
          f" {marginal:.3f}, by the law {law:.3f}, simulated {simulated:.3f}")
    ok &= np.isclose(simulated, law, rtol=0.02) and (marginal < conditional) == quantized
    ok &= np.isclose(marginal, np.hypot(0.5, 0.2)) and any("delta^2/12" in text for text in metadata) == quantized
sys.exit(not (ok and law > 1.1 * marginal))
PY
