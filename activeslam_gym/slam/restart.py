"""A belief that the fiducials contradict is given up, and begun anew.

The fiducials are known; all else is the filter's own. An honest filter predicts them as it says it does: the mean of
their normalised innovations squared (NIS), by degree of freedom, stays near 1. A map whose depths turned inside out,
or that took one landmark for another, is held against them frame after frame, and the update, which weighs
one wrong covariance with another, does not mend it. So a running mean of the NIS is kept, and where that is high the
map is forgotten, and the camera is only known to be not far from where it was thought: what it sees next says where.
Half the NIS is a negative log likelihood, so a fiducial that should be seen and is not counts that of a miss,
-log(1 - detection probability).
(The test of innovations: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
2001, section 5.4. docs/HONESTY.md says how the constants were found.)
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, filled, record
from activeslam_gym.linalg import squared_distance
from activeslam_gym.motion import CAMERA_DIM, D_ANGULAR, D_POSITION, D_ROTATION, D_VELOCITY
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.hypotheses import innovation_with
from activeslam_gym.slam.sight import INSIDE, Sight

RESTART = record(
    gain="f8",  # of a frame in the running mean
    limit="f8",  # of the running mean: over it the belief is contradicted
    least="i8",  # fiducials that a frame must tell of
    most="f8",  # that one fiducial counts
    missing="f8",  # that one counts where it should be seen and is not; 0: something may hide it
    std=("f8", CAMERA_DIM),  # of the camera's tangent, once the belief is given up [m, rad, m/s, rad/s]
)
"""Constants of the restart."""
MEMORY = 0.5
"""Of the running mean [s]."""
LIMIT = 2.5
"""Of the running mean; of 2 800 runs in `paper`, those that were not wrong kept under 2.3 (docs/HONESTY.md)."""
MOST = 10.0
"""That one fiducial counts in a frame."""


def restart_of(scenario: Scenario) -> Record:
    """The RESTART record of a scenario."""
    may_be_hidden = scenario.miss_spacing > 0.0
    std = np.empty(CAMERA_DIM)
    std[D_POSITION], std[D_ROTATION], std[D_VELOCITY], std[D_ANGULAR] = 0.3, 0.1, 0.3, 0.2
    return filled(
        RESTART,
        gain=min(scenario.frame_time / MEMORY, 1.0),
        limit=LIMIT if scenario.restarts else math.inf,
        least=3,
        most=MOST,
        missing=0.0 if may_be_hidden else -math.log(max(1.0 - scenario.detection_probability, math.exp(-MOST))),
        std=std,
    )


@borrowing
def contradicted(
    model: Record,
    belief: Belief,
    sight: Sight,
    candidates: np.ndarray,
    of_thing: np.ndarray,
    waits: np.ndarray,
    pixel_var: float,
) -> bool:
    """Whether the fiducials have contradicted the belief for a while; takes this frame into the running mean.

    ``of_thing`` (v,): the candidates that the things in ``sight`` were taken for, or -1; ``waits`` (v,): those that a
    candidate may be of. ``pixel_var``: that of the R in ``sight.S``.
    """
    total, count = 0.0, 0
    for a in range(of_thing.shape[0]):
        if sight.thing[a].id >= 0:
            continue
        if of_thing[a] >= 0:
            total += min(0.5 * _squared(sight, a, candidates[of_thing[a]], pixel_var), model.most)
            count += 1
        elif model.missing > 0.0 and sight.thing[a].visibility == INSIDE and not waits[a]:
            total += model.missing
            count += 1
    if count >= model.least:
        belief.state.fiducial_nis += model.gain * (total / count - belief.state.fiducial_nis)
    return belief.state.fiducial_nis > model.limit


@borrowing
def _squared(sight: Sight, a: int, candidate: Record, pixel_var: float) -> float:
    """The innovation of thing ``a`` squared, in its own covariance: nu^T S^-1 nu."""
    s00, s01, s11 = innovation_with(sight, a, candidate, pixel_var)
    u, v = candidate.pixel[0] - sight.thing[a].z_hat[0], candidate.pixel[1] - sight.thing[a].z_hat[1]
    return squared_distance(s00, s01, s11, u, v)[0]


@borrowing
def restart(model: Record, belief: Belief) -> None:
    """Forget the map and what was being followed, and widen the camera to ``model.std`` about where it is thought."""
    state, P = belief.state, belief.covariance
    state.count, state.dim, state.fiducial_nis = 0, CAMERA_DIM, 1.0
    for i in range(CAMERA_DIM):
        for j in range(CAMERA_DIM):
            P[i, j] = 0.0
        P[i, i] = model.std[i] * model.std[i]
    for t in range(belief.track.shape[0]):
        belief.track[t].hits = 0
