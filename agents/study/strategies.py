"""The paper's strategies with another reading of what it leaves open: how a candidate action is scored.

They are factories for `package.module:factory`, so that `python -m agents compare --policy` takes them too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion, information
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotate_left, rotation_matrix
from activeslam_gym.information import Prospect, criterion_number
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION, turn_of
from agents.tools.inside import waiting_count
from baselines.greedy import Greedy, greedy
from baselines.policy import Actions, Environment, best

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """How a candidate is scored; the defaults are the environment's."""

    propagated: bool = True
    """The covariance of a candidate motion is propagated over the motion (otherwise: the present one)."""
    gaze_ahead: float | None = None
    """Seconds that a candidate gaze is held before it is scored; one gaze period if not given."""
    capped: bool = False
    """An expected landmark is no less certain than that it lies in the image, where its pixel varies by W²/12."""


class Reread(Greedy):
    """`Greedy` that scores its candidates itself, by another reading. Bound to a single environment."""

    def __init__(
        self,
        env: Environment,
        reading: Reading,
        gaze_criterion: str | None = None,
        motion_criterion: str | None = None,
    ) -> None:
        super().__init__(env, motion_criterion, gaze_criterion)
        self.reading = reading
        ahead = self.env.gaze_period if reading.gaze_ahead is None else reading.gaze_ahead
        self._gaze_frames = round(ahead / self.env.scenario.frame_time)

    def choose_motion(self) -> Actions:
        prospect = self.env.prospect
        motion = self.env.setting.models.motion
        frames = round(self.env.motion_period / motion.dt) if self.reading.propagated else 0
        P = information.propagated(motion, prospect.covariance, 0.0, frames) if frames else prospect.covariance
        poses = [information.pose_after(motion, prospect.camera, index, 0.0) for index in range(len(Motion))]
        return best([[self._score(prospect, P, pose, self.motion_criterion) for pose in poses]])

    def choose_gaze(self) -> Actions:
        if self.gaze_criterion is None:
            return self.always(Gaze.LEFT)
        prospect = self.env.prospect
        return best([[self._gaze_score(prospect, gaze) for gaze in range(len(Gaze))]])

    def _gaze_score(self, prospect: Prospect, gaze: int) -> float:
        """The present position, turned for as long as the reading says."""
        motion, frames = self.env.setting.models.motion, self._gaze_frames
        turn = turn_of(motion, gaze, self.env.time)
        P = information.propagated(motion, prospect.covariance, turn, frames)
        turned = np.array((0.0, turn * motion.dt * frames, 0.0))
        pose = prospect.camera.copy()
        pose[QUATERNION] = rotate_left(turned, pose[QUATERNION])
        return self._score(prospect, P, pose, self.gaze_criterion or "")

    def _score(self, prospect: Prospect, P: Array, pose: Array, criterion: str) -> float:
        if self.reading.capped:
            P = capped(prospect.points, P, pose, waiting_count(self.env), self.env.scenario)
        return information.score(self.env.setting.models.camera, prospect, P, pose, criterion_number(criterion))


def capped(points: Array, P: Array, pose: Array, waiting: int, scenario: Scenario) -> Array:
    """P with the blocks of the `waiting` last points, the expected landmarks, scaled to the image seen from `pose`.

    A point at depth z whose position varies by σ in every direction has a pixel that varies by f σ / z. One that is
    known to lie in an image of width W has at most W/√12. So σ² is scaled by min(1, (W z / (√12 f σ))²).
    """
    if not waiting:
        return P
    out = P.copy()
    R_WC = rotation_matrix(pose[QUATERNION])
    depth = (points[-waiting:] - pose[POSITION]) @ R_WC[:, 2]
    widest = np.sqrt(max(scenario.landmark_prior_variance))
    known = scenario.image_width / np.sqrt(12.0) * np.maximum(depth, scenario.minimum_depth) / scenario.focal_px
    scale = np.minimum(1.0, (known / widest) ** 2)
    diagonal = np.arange(CAMERA_DIM + 3 * (len(points) - waiting), len(P))
    out[diagonal, diagonal] *= np.repeat(scale, 3)
    return out


def _reread(
    reading: Reading, gaze_criterion: str | None, env: Environment, motion_criterion: str | None = None
) -> Greedy:
    return Reread(env, reading, gaze_criterion, motion_criterion)


UNPROPAGATED, GAZE_AHEAD, CAPPED = Reading(propagated=False), Reading(gaze_ahead=1.0), Reading(capped=True)
MI, FISHER = information.MUTUAL_INFORMATION, information.FISHER_TRACE
Factory = Callable[[Environment], Greedy]

unpropagated_mi_constant: Factory = partial(_reread, UNPROPAGATED, None)
unpropagated_mi_mi: Factory = partial(_reread, UNPROPAGATED, MI)
unpropagated_mi_fisher: Factory = partial(_reread, UNPROPAGATED, FISHER)
unpropagated_fisher_fisher: Factory = partial(_reread, UNPROPAGATED, FISHER, motion_criterion=FISHER)
gaze_ahead_mi_mi: Factory = partial(_reread, GAZE_AHEAD, MI)
gaze_ahead_mi_fisher: Factory = partial(_reread, GAZE_AHEAD, FISHER)
capped_mi_constant: Factory = partial(_reread, CAPPED, None)
capped_mi_mi: Factory = partial(_reread, CAPPED, MI)
capped_mi_fisher: Factory = partial(_reread, CAPPED, FISHER)


def mi_eigenvalue(env: Environment) -> Greedy:
    """(iii) with the largest eigenvalue of the Fisher matrix, as the end of section III-B says, for its trace."""
    return greedy(env, gaze_criterion=information.FISHER_MAX_EIGENVALUE)


def eigenvalue_eigenvalue(env: Environment) -> Greedy:
    """Motion too by the largest eigenvalue: what `fisher-fisher` is for the trace."""
    return greedy(env, information.FISHER_MAX_EIGENVALUE, information.FISHER_MAX_EIGENVALUE)
