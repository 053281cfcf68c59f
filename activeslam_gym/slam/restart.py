"""Reset of the filter where the fiducials contradict the belief.

The fiducials are known. A consistent filter keeps the mean of their normalised innovations squared (NIS), by degree of
freedom, near 1. A map whose depths turned inside out, or that took one landmark for another, contradicts them frame
after frame, and the update, which weighs one wrong covariance with another, does not mend it. So a running mean of the
NIS is kept; where it is high, the map is deleted and the camera's covariance is widened. Half the NIS is a negative
log likelihood, so a fiducial that should be seen and is not counts that of a miss, -log(1 - detection probability).
(The test of innovations: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
2001, section 5.4. docs/notes.md says how the constants were found.)
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, constants
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.detection import WAITS, distance_by_own_noise
from activeslam_gym.slam.sight import INSIDE, Sight

MEMORY = 0.5  # of the running mean [s]
LIMIT = 2.5  # of the running mean; in `paper`, 2 800 runs that were not wrong kept under 2.3 (at commit fbfc631b)
LEAST, MOST = 3, 10.0  # fiducials that a frame must tell of; the most that one of them counts in a frame


def _missing(scenario: Scenario) -> float:
    """The count of a fiducial that should be seen and is not, -ln(1 - P_D); 0 where something may hide it."""
    if scenario.miss_spacing > 0.0:
        return 0.0
    return -math.log(max(1.0 - scenario.detection_probability, math.exp(-MOST)))


RESTART, restart_of = constants(
    Scenario(),
    gain=lambda s: min(s.frame_time / MEMORY, 1.0),  # of a frame in the running mean
    limit=lambda s: LIMIT if s.restarts else math.inf,  # over it the belief is contradicted
    missing=_missing,
    std=np.repeat([0.3, 0.1, 0.3, 0.2], 3),  # of the camera's tangent after the reset [m, rad, m/s, rad/s]
)
"""Constants of the restart."""


@borrowing
def contradicted(model: Record, belief: Belief, sight: Sight, detections: np.ndarray, matches: np.ndarray) -> bool:
    """Whether the fiducials have contradicted the belief for a while; takes this frame into the running mean.

    ``matches`` (v,): the detections of the predictions in ``sight``, or MISSED, or WAITS.
    """
    total, count = 0.0, 0
    for a in range(matches.shape[0]):
        if sight.point[a].id >= 0:
            continue
        if matches[a] >= 0:
            point, S = sight.point[a], sight.S[2 * a : 2 * a + 2, 2 * a : 2 * a + 2]
            total += min(0.5 * distance_by_own_noise(point.z_hat, S, point.R, detections[matches[a]])[0], MOST)
            count += 1
        elif model.missing > 0.0 and sight.point[a].visibility == INSIDE and matches[a] != WAITS:
            total += model.missing
            count += 1
    if count >= LEAST:
        belief.state.fiducial_nis += model.gain * (total / count - belief.state.fiducial_nis)
    return belief.state.fiducial_nis > model.limit


@borrowing
def restart(model: Record, belief: Belief) -> None:
    """Delete the map and all tracks, and widen the camera's covariance to ``model.std`` about its mean; biases stay."""
    state, P = belief.state, belief.covariance
    state.count, state.dim, state.fiducial_nis = 0, CAMERA_DIM + state.bias_dim, 1.0
    for i in range(CAMERA_DIM):
        for j in range(state.dim):
            P[i, j], P[j, i] = 0.0, 0.0
        P[i, i] = model.std[i] * model.std[i]
    belief.track["hits"][:] = 0
