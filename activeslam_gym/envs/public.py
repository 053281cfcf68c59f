"""The public reads of an environment, for policies and for the evaluator; the same names for one and for a batch."""

from dataclasses import dataclass, field

import numpy as np

from activeslam_gym.config import whole_number
from activeslam_gym.envs.evaluation import Labels, features_of_landmarks
from activeslam_gym.envs.planning import Scores, predicted_belief
from activeslam_gym.envs.run import Run
from activeslam_gym.information.candidates import PredictedBelief
from activeslam_gym.kernels import row
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION
from activeslam_gym.slam.estimate import Estimate, read_only, taken_estimate
from activeslam_gym.threads import Workers
from activeslam_gym.world.truth import Truth, truth_of


@dataclass(frozen=True)
class PublicBelief(Estimate):
    """The estimate of an environment, and its entropies; read-only copies."""

    log2_dets: dict[str, float] = field(default_factory=dict)
    """log2 |P| of ``camera``, ``map`` and ``total`` at the constant dimension."""

    def log2_det(self, part: str = "total") -> float:
        """log2 |P| of a part at its constant dimension: 12, 3 N or 12 + 3 N (an unmapped landmark at its prior).

        Raises:
            ValueError: ``part`` is none of ``camera``, ``map`` and ``total``.
        """
        if part not in self.log2_dets:
            raise ValueError(f"part must be one of {', '.join(self.log2_dets)}, got {part!r}")
        return self.log2_dets[part]


def public_belief(run: Run) -> PublicBelief:
    """A read-only copy of the estimate."""
    e = run.episode.evaluation
    log2_dets = {part: float(e[f"log2_det_{part}"]) for part in ("camera", "map", "total")}
    return PublicBelief(**vars(taken_estimate(run.estimate)), log2_dets=log2_dets)


def _nees_per_dof(run: Run) -> dict[str, float]:
    """NEES over its degrees of freedom; for landmarks the mean over the mapped ones, NaN if there are none."""
    landmark, P = run.estimate.landmark[: int(run.estimate.state.count)], run.estimate.covariance
    error = camera_error(run.world.state.camera, run.estimate.state.camera)
    of_landmark = features_of_landmarks(run.owner, len(run.world.landmarks), landmark["mapped"])
    each = []
    for y, k in zip(run.world.landmarks, of_landmark.tolist(), strict=True):
        if k >= 0:
            at = slice(CAMERA_DIM + 3 * k, CAMERA_DIM + 3 * k + 3)
            each.append(nees(y - landmark["point"][k], P[at, at]) / 3.0)
    return {
        "position": nees(error[D_POSITION], P[D_POSITION, D_POSITION]) / 3.0,
        "orientation": nees(error[D_ROTATION], P[D_ROTATION, D_ROTATION]) / 3.0,
        "landmarks": float(np.mean(each)) if each else float("nan"),
    }


class SingleReads(Scores):
    """Of one run: a batch of one, or one row of a larger batch, of which it shows the present state."""

    _single = True

    @property
    def _run(self) -> Run:
        return self._at(0)

    @property
    def belief(self) -> PublicBelief:
        """The belief, with every feature as a point; read-only."""
        return public_belief(self._run)

    @property
    def predicted_belief(self) -> PredictedBelief:
        """What the criteria score: the belief without rays, and the landmarks that are expected and not found yet.

        A copy, in the form that the functions of `information` take, for policies with a criterion of their own.
        """
        given = predicted_belief(self._run)
        return given._replace(fiducials=given.fiducials.copy(), boxes=given.boxes.copy())

    @property
    def truth(self) -> Truth:
        """The ground truth: for the evaluator, never for policies."""
        return truth_of(self._run.world, self._scenes()[0])

    @property
    def room_size(self) -> np.ndarray:
        """(3,) the present room's size along X, Y, Z [m]; the scenario has that of a room that no episode varies."""
        return 2.0 * self._run.models.motion.half

    @property
    def labels(self) -> Labels:
        """Data association by the hidden labels; read-only copies for the evaluator, never for policies."""
        run, count = self._run, int(self._run.episode.detection_count)
        owners = run.owner["landmark"][: int(run.estimate.state.count)]
        return Labels(read_only(owners), read_only(run.label[:count]), read_only(run.detections["match"][:count]))

    def nees(self) -> dict[str, float]:
        """NEES per degree of freedom of ``position``, ``orientation``, ``landmarks`` (mean of the mapped, or NaN)."""
        return _nees_per_dof(self._run)


class BatchReads(Scores):
    """Of a batch."""

    def run(self, i: int) -> SingleReads:
        """What a single environment lets read, of environment ``i`` and its present state at the time of reading.

        Raises:
            ValueError: there is no such environment.
        """
        count = len(self._runs.episode)
        if whole_number("i", i, 0) >= count:
            raise ValueError(f"i must be in 0 … {count - 1}, got {i!r}")
        own = slice(i, i + 1)
        one = SingleReads(self.setting, row(self._runs, own), Workers(1, alone=self._workers.alone))
        one._perceptions, one._encoding, one.render_mode = self._perceptions[own], self._encoding, self.render_mode
        return one

    @property
    def belief(self) -> tuple[PublicBelief, ...]:
        """The beliefs, with every feature as a point; read-only."""
        return tuple(public_belief(run) for run in self._each())

    @property
    def truth(self) -> Truth:
        """The ground truths: for the evaluator, never for policies."""
        return truth_of(self._runs.world, self._scenes())

    def nees(self) -> dict[str, np.ndarray]:
        """(B,) NEES per degree of freedom of ``position``, ``orientation``, ``landmarks``; see `SingleReads.nees`."""
        each = [_nees_per_dof(run) for run in self._each()]
        return {name: np.array([one[name] for one in each]) for name in each[0]}
