"""Reading a run: information, views and history, as fresh Python objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from activeslam_gym.batching import row
from activeslam_gym.camera import CameraModel
from activeslam_gym.compilation import part
from activeslam_gym.envs.frame import EVENTS, Simulation
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.envs.scoring import features_of_landmarks, landmark_errors
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import (
    ENTROPY,
    LOG2_CAMERA,
    LOG2_MAP,
    LOG2_TOTAL,
    LOST,
    MAPPED,
    STEPS,
    VALUES,
    Run,
)
from activeslam_gym.envs.views import PublicBelief, PublicBeliefs, Snapshot, Truth
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    D_POSITION,
    D_ROTATION,
    POSITION,
    QUATERNION,
    VELOCITY,
    Gaze,
    Motion,
)
from activeslam_gym.slam.belief import FEATURES
from activeslam_gym.slam.measurement import UNSEEN, predict_measurements

_COUNTS = ("landmarks_mapped", "distinct_landmarks")
_PLAIN = [(name, VALUES.index(name)) for name in VALUES if not name.startswith("log2_det")]
_TERMS = (*REWARDS, "forfeit")


def info_of(run: Run) -> dict[str, Any]:
    """The `info` of the last step, of plain Python values."""
    step = run.step
    lost = bool(step.status[LOST])
    return _named(step.values.tolist(), lost, step.terms.tolist(), run.simulation.events.tolist(), int)


def infos_of(runs: Run, included: np.ndarray) -> dict[str, Any]:
    """The `infos` of the last step of a batch, as Gymnasium's vector environments have them.

    An array (B,) for each number of `info_of`, in the same nested dicts, and beside each ``key`` a mask ``_key`` (B,)
    of the environments that it is of: those ``included`` (B,) bool; the others' numbers are 0.
    """
    values, terms, events = (
        np.where(included, array.T, array.dtype.type(0))
        for array in (runs.step.values, runs.step.terms, runs.simulation.events)
    )
    lost = included & (runs.step.status[:, LOST] == 1)
    return with_masks(_named(values, lost, terms, events, lambda column: column.astype(np.int64)), included)


def with_masks(infos: dict[str, Any], included: np.ndarray) -> dict[str, Any]:
    """``infos`` with a mask ``_key`` beside each ``key``, in nested dicts too."""
    masked: dict[str, Any] = {}
    for key, value in infos.items():
        masked[key] = with_masks(value, included) if isinstance(value, dict) else value
        masked[f"_{key}"] = included.copy()
    return masked


def info_at(infos: dict[str, Any], i: int) -> dict[str, Any]:
    """The `info` of environment ``i`` in the `infos` of a batch: the inverse of `infos_of`."""
    return {
        key: info_at(value, i) if isinstance(value, dict) else value[i].item()
        for key, value in infos.items()
        if not key.startswith("_")
    }


def _named(values: Any, lost: Any, terms: Any, events: Any, whole: Callable[[Any], Any]) -> dict[str, Any]:
    """The tree of `info`, of the numbers of one run or of columns (B,) of numbers; ``whole`` makes them integers."""
    info: dict[str, Any] = {name: values[at] for name, at in _PLAIN}
    for name in _COUNTS:
        info[name] = whole(info[name])
    info["log2_det"] = {"camera": values[LOG2_CAMERA], "map": values[LOG2_MAP], "total": values[LOG2_TOTAL]}
    info["lost"] = lost
    info["reward_terms"] = dict(zip(_TERMS, terms, strict=True))
    info["events"] = dict(zip(EVENTS, events, strict=True))
    return info


def _frozen(array: np.ndarray) -> np.ndarray:
    copy = np.array(array)
    copy.flags.writeable = False
    return copy


def public_belief(run: Run) -> PublicBelief:
    """A read-only copy of the public belief."""
    simulation, values = run.simulation, run.step.values
    camera, n = simulation.belief.camera, int(simulation.belief.size[FEATURES])
    size = CAMERA_DIM + 3 * n
    return PublicBelief(
        position=_frozen(camera[POSITION]),
        quaternion=_frozen(camera[QUATERNION]),
        velocity=_frozen(camera[VELOCITY]),
        angular_velocity=_frozen(camera[ANGULAR_VELOCITY]),
        landmarks=_frozen(simulation.points[:n]),
        mapped=_frozen(simulation.mapped[:n]),
        covariance=_frozen(simulation.covariance[:size, :size]),
        log2_dets={
            "camera": float(values[LOG2_CAMERA]),
            "map": float(values[LOG2_MAP]),
            "total": float(values[LOG2_TOTAL]),
        },
    )


def public_beliefs(runs: Run) -> PublicBeliefs:
    """A read-only copy of the public beliefs of a batch."""
    return PublicBeliefs(public_belief(row(runs, i)) for i in range(len(runs.step.status)))


def truth_of(run: Run) -> Truth:
    """A read-only copy of the truth of a run, or of a batch of them: the same with a leading axis."""
    world = run.simulation.world
    K = _fiducial_count(run)
    return Truth(
        position=_frozen(world.camera[..., POSITION]),
        quaternion=_frozen(world.camera[..., QUATERNION]),
        velocity=_frozen(world.camera[..., VELOCITY]),
        angular_velocity=_frozen(world.camera[..., ANGULAR_VELOCITY]),
        landmarks=_frozen(world.points[..., K:, :]),
        fiducials=_frozen(world.points[..., :K, :]),
    )


def _fiducial_count(run: Run) -> int:
    return run.simulation.world.points.shape[-2] - run.simulation.expectation.points.shape[-2]


@part
def _mapped_landmarks(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """(L,) position k of each true landmark's mapped feature, or -1; (L,) its distance [m], or NaN."""
    N = simulation.expectation.points.shape[0]
    K = simulation.world.points.shape[0] - N
    of_landmark = features_of_landmarks(simulation.labels, simulation.belief, N, simulation.mapped)
    return of_landmark, landmark_errors(simulation.world, simulation.points, of_landmark, K)


def landmark_distances(runs: Run) -> np.ndarray:
    """(B, L) distance of each true landmark from its mapped feature [m]; NaN where it has none."""
    rows = (row(runs, i) for i in range(len(runs.step.status)))
    return np.stack([_mapped_landmarks(run.simulation)[1] for run in rows])


def nees_per_dof(run: Run) -> dict[str, float]:
    """NEES over its degrees of freedom; for landmarks the mean over the mapped ones, NaN if there are none."""
    simulation = run.simulation
    error = camera_error(simulation.world.camera, simulation.belief.camera)
    P = simulation.covariance
    of_landmark, _ = _mapped_landmarks(simulation)
    K = _fiducial_count(run)
    landmarks = []
    for landmark, k in enumerate(of_landmark.tolist()):
        if k >= 0:
            at = slice(CAMERA_DIM + 3 * k, CAMERA_DIM + 3 * k + 3)
            landmarks.append(nees(simulation.world.points[K + landmark] - simulation.points[k], P[at, at]) / 3.0)
    return {
        "position": float(nees(error[D_POSITION], P[D_POSITION, D_POSITION])) / 3.0,
        "orientation": float(nees(error[D_ROTATION], P[D_ROTATION, D_ROTATION])) / 3.0,
        "landmarks": float(np.mean(landmarks)) if landmarks else float("nan"),
    }


class History:
    """What a picture shows of the past: kept only by environments that render."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.true_positions: list[np.ndarray] = []
        self.positions: list[np.ndarray] = []
        self.entropy: list[float] = []
        self.landmark_times: list[float] = []
        self._most_mapped = 0

    def record(self, time: float, run: Run) -> None:
        """Add the present moment."""
        self.times.append(time)
        self.true_positions.append(run.simulation.world.camera[POSITION].copy())
        self.positions.append(run.simulation.belief.camera[POSITION].copy())
        self.entropy.append(float(run.step.values[ENTROPY]))
        mapped = int(run.step.values[MAPPED])
        self.landmark_times.extend([time] * (mapped - self._most_mapped))
        self._most_mapped = max(self._most_mapped, mapped)


def _predicted_ellipses(camera: CameraModel, run: Run) -> tuple[np.ndarray, np.ndarray]:
    fiducials = run.simulation.world.points[: _fiducial_count(run)]
    predictions = predict_measurements(camera, run.simulation.belief, fiducials)
    seen = predictions.visibility != UNSEEN
    return predictions.z_hat[seen], predictions.S[seen]


def snapshot_of(setting: Setting, run: Run, gaze: Gaze, history: History) -> Snapshot:
    """The present moment of a run."""
    belief, truth = public_belief(run), truth_of(run)
    simulation = run.simulation
    predicted, predicted_covariance = _predicted_ellipses(setting.models.camera, run)
    scenario = setting.scenario
    return Snapshot(
        scenario=scenario,
        time=int(run.step.status[STEPS]) * setting.gaze_period,
        duration=setting.duration,
        motion=Motion(int(simulation.control.command[0])),
        gaze=gaze,
        room_size=np.array(scenario.room_size),
        true_position=truth.position,
        true_quaternion=truth.quaternion,
        true_landmarks=truth.landmarks,
        fiducials=truth.fiducials,
        position=belief.position,
        quaternion=belief.quaternion,
        covariance=belief.covariance,
        landmarks=belief.landmarks,
        mapped=belief.mapped,
        expected_landmarks=simulation.expectation.points[simulation.expectation.slot < 0],
        detections=simulation.detections.pixels[: int(simulation.detections.used[0])].copy(),
        predicted=predicted,
        predicted_covariance=predicted_covariance,
        true_trajectory=np.reshape(history.true_positions, (-1, 3)),
        estimated_trajectory=np.reshape(history.positions, (-1, 3)),
        times=np.array(history.times),
        entropy=np.array(history.entropy),
        landmark_times=np.array(history.landmark_times),
        image_size=np.array([scenario.image_width, scenario.image_height], float),
    )
