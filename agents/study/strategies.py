"""The paper's strategies with another reading of what it leaves open: how a candidate action is scored.

They are factories for `package.module:factory`, so that `python -m agents compare --policies` takes them too.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information import CRITERIA
from activeslam_gym.information.candidates import gaze_plans, motion_plans, pose_after, propagated, sight_after
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION, turn_of
from baselines.greedy import Greedy, greedy
from baselines.policy import Actions, Environment, best

Array = NDArray[np.float64]


class Reread(Greedy):
    """`Greedy` that scores its candidates itself, by another reading. Bound to a single environment.

    ``propagated``: the covariance of a candidate motion is propagated over the motion; otherwise it is the present one.
    ``capped``: an expected landmark is no less certain than that it lies in the image, where its pixel varies by W²/12.
    """

    def __init__(self, env: Environment, propagated: bool = True, capped: bool = False, **criteria: str | None) -> None:
        super().__init__(env, **criteria)
        frame = self.env.scenario.frame_time
        self._motions = motion_plans(round(self.env.motion_period / frame) if propagated else 0)
        self._gazes = gaze_plans(round((self.env.scenario.gaze_horizon or self.env.gaze_period) / frame))
        self._scores = self._capped_scores if capped else self.env.scores

    def choose_motion(self) -> Actions:
        return best([self._scores(self._motions, self.motion_criterion)])

    def choose_gaze(self) -> Actions:
        if self.gaze_criterion is None:
            return self.always(Gaze.LEFT)
        return best([self._scores(self._gazes, self.gaze_criterion)])

    def _capped_scores(self, plans: NDArray, criterion: str) -> Array:
        """(A,) of plans of one action: the environment's own scores, with the covariance capped for each pose."""
        models, prospect, scenario = self.env.setting.models, self.env.prospect, self.env.scenario
        camera, motion, out = models.camera, models.motion, np.zeros(len(plans))
        for a, (index, gaze, frames) in enumerate(plans[:, 0].tolist()):
            turn = turn_of(motion, gaze, self.env.time)
            pose = pose_after(motion, prospect.camera, index, turn, frames)
            P = propagated(motion, prospect.covariance, turn, frames)
            P = capped(prospect.points, P, pose, prospect.waiting, scenario)
            sight = sight_after(camera, prospect, P, pose)
            if len(sight.thing):
                out[a] = CRITERIA[criterion](P, sight, camera.pixel_std**2)
        return out


def capped(points: Array, P: Array, pose: Array, waiting: int, scenario: Scenario) -> Array:
    """P with the blocks of the `waiting` last points, the expected landmarks, scaled to the image seen from `pose`.

    A point at depth z whose position varies by σ in every direction has a pixel that varies by f σ / z. One that is
    known to lie in an image of width W has at most W/√12. So σ² is scaled by min(1, (W z / (√12 f σ))²).
    """
    if not waiting:
        return P
    out = P.copy()
    depth = (points[-waiting:] - pose[POSITION]) @ rotation_matrix(pose[QUATERNION])[:, 2]
    widest = np.sqrt(max(scenario.landmark_prior_variance))
    known = scenario.image_width / np.sqrt(12.0) * np.maximum(depth, scenario.minimum_depth) / scenario.focal_px
    diagonal = np.arange(CAMERA_DIM + 3 * (len(points) - waiting), len(P))
    out[diagonal, diagonal] *= np.repeat(np.minimum(1.0, (known / widest) ** 2), 3)
    return out


MI, FISHER, EIGENVALUE = "mutual_information", "fisher_trace", "fisher_max_eigenvalue"

unpropagated_mi_constant = partial(Reread, propagated=False)
unpropagated_mi_mi = partial(Reread, propagated=False, gaze_criterion=MI)
unpropagated_mi_fisher = partial(Reread, propagated=False, gaze_criterion=FISHER)
unpropagated_fisher_fisher = partial(Reread, propagated=False, gaze_criterion=FISHER, motion_criterion=FISHER)
capped_mi_constant = partial(Reread, capped=True)
capped_mi_mi = partial(Reread, capped=True, gaze_criterion=MI)
capped_mi_fisher = partial(Reread, capped=True, gaze_criterion=FISHER)
mi_eigenvalue = partial(greedy, gaze_criterion=EIGENVALUE)
"""(iii) with the largest eigenvalue of the Fisher matrix, as the end of section III-B says, for its trace."""
eigenvalue_eigenvalue = partial(greedy, motion_criterion=EIGENVALUE, gaze_criterion=EIGENVALUE)
"""Motion too by the largest eigenvalue: the counterpart of `fisher-fisher`, which takes the trace."""
