"""The public reads of an environment, for policies and for the evaluator; the same names for one and for a batch."""

from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from activeslam_gym.envs.actions import action_masks
from activeslam_gym.envs.evaluation import Labels, features_of_landmarks, landmark_errors
from activeslam_gym.envs.observation import context_of
from activeslam_gym.envs.planning import frames_left, net_of_runs, predicted_belief, score_runs
from activeslam_gym.envs.reset import box_scene
from activeslam_gym.envs.run import Run
from activeslam_gym.envs.runs import Runs
from activeslam_gym.information import candidates
from activeslam_gym.information.candidates import PredictedBelief, sight_after
from activeslam_gym.information.criteria import CRITERIA, NET, Criterion
from activeslam_gym.information.foreign import score_plans_with, sight_by
from activeslam_gym.information.net import Forecast
from activeslam_gym.kernels import row, uncompiled
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION, GAZE_COUNT, MOTION_COUNT
from activeslam_gym.registry import FOREIGN, asked, name_of, number_of
from activeslam_gym.sensors.sensor import OWN_SENSORS
from activeslam_gym.slam.estimate import Estimate, read_only, taken_estimate
from activeslam_gym.threads import Workers
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.truth import Truth, truth_of

_LONGEST_HORIZON = 4
_SENSOR_NAMES = tuple(OWN_SENSORS)  # which a part that is no string is none of, whether it has a hash or not


@dataclass(frozen=True)
class PublicBelief(Estimate):
    """The estimate of an environment, and its entropies; read-only copies."""

    anchors: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) where the line of sight of a feature that is not converted yet begins, as it is estimated now [m]."""
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
    e, given = run.episode.evaluation, taken_estimate(run.estimate)
    return PublicBelief(
        **{one.name: getattr(given, one.name) for one in fields(given)},
        anchors=read_only(run.estimate.landmark["anchor"][: len(given.ids)]),
        log2_dets={part: float(e[f"log2_det_{part}"]) for part in ("camera", "map", "total")},
    )


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


class Reads(Runs):
    """What may be read of B runs: a batch has a leading axis B, a single environment (B = 1) none."""

    def _given(self, batch: np.ndarray) -> Any:
        """``batch`` (B, ...) as readers get it."""
        raise NotImplementedError

    # For policies ---------------------------------------------------------------------------------------------------

    @property
    def motion_phase(self) -> Any:
        """Steps since the present motion period began; the next step's motion is read where this is 0."""
        return self._given(self._runs.episode["steps"] % self.steps_per_motion)

    @property
    def time(self) -> Any:
        """Time since the reset [s]."""
        return self._given(self._runs.episode["steps"] * self.gaze_period)

    def action_masks(self) -> np.ndarray:
        """(10,) bool, motions and then gazes (discrete: (21,)): false for a motion that the next step would ignore.

        Sb3-contrib's `MaskablePPO` reads it.

        Raises:
            AttributeError: the actions are continuous.
        """
        episode = self._runs.episode
        phases = episode["steps"] % self.steps_per_motion
        return self._given(action_masks(self._encoding.space(), episode["control"]["command"], phases))

    @property
    def context(self) -> Any:
        """What a policy for several scenarios needs beside the observation; `CONTEXT_FEATURES`."""
        return self._given(context_of(self._runs, self.duration))

    def scores(self, plans: np.ndarray, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(A,) what each of ``plans`` (A, L) of `information.candidates.ACTION` would teach.

        Raises:
            ValueError: there is no such criterion, motion or gaze, or ``plans`` is no such array; or a foreign
                criterion returns anything but a finite number.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._scores(candidates.checked_plans(plans), criterion)

    def forecast(self, plans: np.ndarray) -> Forecast:
        """(A,) net information [bit] of each of ``plans`` (A, L), and its greatest position deviation [m].

        With measurements on the way; raises as `scores`.
        """
        return Forecast(*map(self._given, self._evaluated(candidates.checked_plans(plans), "net_information")))

    def _scores(self, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        return self._given(self._evaluated(plans, criterion)[0])

    def _evaluated(self, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        """(2, B, A) scores of ``plans``, and `Forecast.position_std`, which `score_runs` leaves at 0."""
        number = number_of("criterion", criterion, CRITERIA)
        out, own_sensor = np.zeros((2, len(self._runs.episode), len(plans))), self.scenario.sensor in _SENSOR_NAMES
        if not self._runs.episode["begun"].all():
            raise gymnasium.error.ResetNeeded("there is nothing to score before the first reset()")
        if number == NET and own_sensor:
            self._workers.call(net_of_runs, self._runs, plans, self.gaze_period, out)
        elif number != FOREIGN and own_sensor:
            self._workers.call(score_runs, self._runs, plans, self.gaze_period, number, out[0])
        else:
            for i in range(out.shape[1]):
                out[:, i] = self._evaluated_in_python(i, plans, criterion)
        return out

    def _evaluated_in_python(self, i: int, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        """(2, A) what `_evaluated` gives run ``i``, with a foreign sensor or by a foreign criterion."""
        run = row(self._runs, i)
        given, lens, time = predicted_belief(run), run.models.lens, int(run.episode.steps) * self.gaze_period
        if criterion == "net_information":
            given = candidates.without_present(lens, given)
        var = float(lens.pixel_std**2)
        if self.scenario.sensor in _SENSOR_NAMES:
            look = partial(sight_after, lens, given)
        else:
            sight = partial(sight_by, self._perceptions[i].sensor, given, var)
            where = f" in frame {int(run.world.state.frame)} of environment {i}"
            look = partial(asked, f"the sensor {name_of(self.scenario.sensor)!r}", sight, where=where)
        frames = int(uncompiled(frames_left)(run))
        return score_plans_with(look, run.models.motion, given, time, plans, criterion, var, frames)

    def motion_scores(self, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(7,) what each motion would teach at its clipped goal, gaze STAY; see `information`.

        The covariance is propagated over the motion period from the present estimate, and one set of measurements is
        taken there. In bits for mutual information.

        Raises:
            ValueError: there is no such criterion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._scores(self._motion_plans, criterion)

    def gaze_scores(self, criterion: str | Criterion = "fisher_trace") -> np.ndarray:
        """(3,) what each turn would teach at the present position; raises as `motion_scores`.

        After one gaze period, or the scenario's ``gaze_horizon``.
        """
        return self._scores(self._gaze_plans, criterion)

    def joint_scores(self, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(7, 3) what each motion would teach with each gaze held for its period; raises as `motion_scores`."""
        scores = self._scores(self._joint_plans, criterion)
        return np.swapaxes(scores.reshape(*scores.shape[:-1], GAZE_COUNT, MOTION_COUNT), -1, -2)

    def motion_score(self, motion: int, criterion: str | Criterion = "mutual_information") -> Any:
        """What one motion would teach; see `motion_scores`, and raises so, and ValueError for a motion that is none."""
        if motion not in range(MOTION_COUNT):
            raise ValueError(f"motion must be in 0 … {MOTION_COUNT - 1}, got {motion!r}")
        scores = self._scores(self._motion_plans[int(motion) :][:1], criterion)[..., 0]
        return scores if scores.ndim else scores.item()

    def lookahead_scores(self, horizon: int = 2) -> np.ndarray:
        """(7,) mutual information [bit] of each motion and the best that may follow it, ``horizon`` motions in all.

        Raises:
            ValueError: ``horizon`` is not 1, 2, 3 or 4 (there are 7^horizon sequences).
            gymnasium.error.ResetNeeded: no run has begun.
        """
        if horizon not in range(1, _LONGEST_HORIZON + 1):
            raise ValueError(f"horizon must be a whole number in 1 … {_LONGEST_HORIZON}, got {horizon!r}")
        scores = self._scores(candidates.sequence_plans(self._motion_frames, int(horizon)), "mutual_information")
        return scores.reshape(*scores.shape[:-1], MOTION_COUNT, -1).max(axis=-1)

    # For the evaluator ----------------------------------------------------------------------------------------------

    @property
    def landmark_errors(self) -> np.ndarray:
        """(L,) distance of each true landmark from its mapped feature [m]; NaN where it is not mapped."""
        each = [landmark_errors(run.owner, run.world.landmarks, run.estimate) for run in self._each()]
        return self._given(np.stack(each))

    def _scenes(self) -> tuple[Scene, ...]:
        """The scene of each run."""
        foreign = [getattr(perception, "scene", None) for perception in self._perceptions]
        return tuple(scene or box_scene(row(self._runs, i)) for i, scene in enumerate(foreign))


class SingleReads(Reads):
    """Of one run: a batch of one, or one row of a larger batch, of which it shows the present state."""

    @property
    def _run(self) -> Run:
        return self._at(0)

    def _given(self, batch: np.ndarray) -> Any:
        return batch[0] if batch.ndim > 1 else batch[0].item()

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
    def labels(self) -> Labels:
        """Data association by the hidden labels; read-only copies for the evaluator, never for policies."""
        run, count = self._run, int(self._run.episode.detection_count)
        owners = run.owner["landmark"][: int(run.estimate.state.count)]
        return Labels(read_only(owners), read_only(run.label[:count]), read_only(run.detections["match"][:count]))

    def expect(self, points: np.ndarray) -> None:
        """Put the expected landmarks at ``points`` (N, 3) [m]: for studies. A reset draws them again.

        Raises:
            ValueError: not as many points as the scenario has landmarks.
        """
        places = np.asarray(points, float)
        if places.shape != self._run.expected["point"].shape:
            raise ValueError(f"points must be of shape {self._run.expected['point'].shape}, got {places.shape}")
        self._run.expected["point"] = places

    def nees(self) -> dict[str, float]:
        """NEES per degree of freedom of ``position``, ``orientation``, ``landmarks`` (mean of the mapped, or NaN)."""
        return _nees_per_dof(self._run)


class BatchReads(Reads):
    """Of a batch."""

    def _given(self, batch: np.ndarray) -> Any:
        return batch

    def run(self, i: int) -> SingleReads:
        """What a single environment lets read, of environment ``i`` and its present state at the time of reading.

        Raises:
            ValueError: there is no such environment.
        """
        count = len(self._runs.episode)
        if i not in range(count):
            raise ValueError(f"i must be in 0 … {count - 1}, got {i!r}")
        one = SingleReads(self.setting, row(self._runs, slice(i, i + 1)), Workers(1, alone=self._workers.alone))
        one._perceptions = self._perceptions[i : i + 1]
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
