"""The landmarks that the scenario of a live run expects, as in `ActiveSLAM-v0`: entropies have a constant dimension.

A room holds N landmarks. Features stand for some; each of the others holds its prior and makes exploration worthwhile.
"""

from dataclasses import replace

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.outside import OutsideRun
from activeslam_gym.information.candidates import PredictedBelief, predicted_belief_of
from activeslam_gym.information.entropy import gathered, log2_dets
from activeslam_gym.information.expectation import EXPECTED, WAITING, update_expectation
from activeslam_gym.information.sensor_limits import SensorLimits
from activeslam_gym.kernels import record
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.motion import MOTION_COUNT
from activeslam_gym.vision.frontend import FrontEnd

_PARTS = ("camera", "pose", "map", "total")
_LOG2_DETS = record(**{f"log2_det_{part}": "f8" for part in _PARTS})


def points_anywhere(scenario: Scenario, seed: np.random.SeedSequence) -> np.ndarray:
    """(N, 3) a point for each landmark of the ``scenario``, uniform in its room [m]."""
    return (np.random.default_rng(seed).random((scenario.landmark_count, 3)) - 0.5) * np.array(scenario.room_size)


class ExpectedMap:
    """The N landmarks of a ``scenario`` and the features of ``front_end`` that stand for them; drawn from ``seed``."""

    def __init__(self, scenario: Scenario, front_end: FrontEnd, seed: np.random.SeedSequence) -> None:
        self._front_end, self._filter, self.camera = front_end, front_end.filter, front_end.camera
        self._limits = SensorLimits(front_end.settings.most_change, front_end.settings.visible)
        self.landmark_var = np.array(scenario.landmark_prior_variance)
        """(3,) of a landmark without a feature, each axis [m^2]."""
        self._expected = np.zeros(scenario.landmark_count, EXPECTED)
        self._expected["point"] = points_anywhere(scenario, seed)

    def update(self) -> None:
        """Assign landmarks to features, after a frame."""
        update_expectation(self._expected, self.landmark_var, self._front_end.estimate())

    def predicted_belief(self) -> PredictedBelief:
        """The input of a planner."""
        filter, clearance = self._filter, np.full(MOTION_COUNT, np.inf)
        first_seen, places = self._front_end.first_seen(filter.ids), (filter.fiducials, filter.boxes)
        own = self._front_end.estimate(), self._expected, self.landmark_var
        return predicted_belief_of(*own, *places, clearance, self._limits, first_seen)

    def outside_run(self, scenario: Scenario, period: float) -> OutsideRun:
        """What stands in for an environment before a policy that decides once a ``period`` [s]."""
        own = replace(scenario, fiducial_count=len(self._filter.fiducials))
        return OutsideRun(own, period, self._limits)

    def observed_by(self, run: OutsideRun, gain: float) -> np.ndarray:
        """(D,) the observation of the present state; ``gain``: entropy removed so far [bit]."""
        first_seen, fiducials = self._front_end.first_seen(self._filter.ids), self._filter.fiducials
        return run.observed(self._front_end.estimate(), first_seen, self._expected, fiducials, gain)

    def factored(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Position k (N,) of each landmark's feature, or -1; and a factor U of the covariance of those and the camera.

        U begins with the features in the landmarks' order. It is None where the covariance is not positive definite.
        """
        serials = self._expected["serial"]
        of_landmark = np.where(serials == WAITING, -1, np.searchsorted(self._filter.ids, serials))
        U = gathered(self._front_end.estimate().covariance, of_landmark[of_landmark >= 0], of_landmark[:0])
        return of_landmark, U if cholesky_in_place(U) else None

    def log2_dets(self) -> np.ndarray:
        """(3,) log2 |P| of camera (12), map (3 N) and total (12 + 3 N): the paper's figure 5 (a).

        It mixes metres, radians and their rates. NaN where the covariance is not positive definite.
        """
        of_landmark, U = self.factored()
        if U is None:
            return np.full(3, np.nan)
        out, counting = np.zeros(1, _LOG2_DETS)[0], of_landmark[of_landmark >= 0]
        waiting, covariance = len(of_landmark) - len(counting), self._front_end.estimate().covariance
        log2_dets(self.landmark_var, waiting, covariance, U, counting, len(counting), out)
        return np.array([out[f"log2_det_{part}"] for part in ("camera", "map", "total")])
