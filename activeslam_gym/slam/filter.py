"""The filter's constants, and the filter without an environment: it takes pixels from anywhere."""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym.camera import CAMERA, camera_of
from activeslam_gym.config import Scenario
from activeslam_gym.kernels import constants, filled, record, row
from activeslam_gym.motion import CAMERA_DIM, CAMERA_SIZE, MOTION, QUATERNION, motion_of
from activeslam_gym.registry import array_of
from activeslam_gym.slam.appearance import appearance_of, draw_bias, use_identified, wander
from activeslam_gym.slam.association import associate, association_of
from activeslam_gym.slam.belief import (
    AZIMUTH,
    INVERSE_DEPTH,
    KIND_DIM,
    MOST_BIASED,
    NEVER,
    Belief,
    empty_beliefs,
    fiducial_id,
    mapped_of,
    positions_of,
    reset_belief,
    start_of,
    write_estimate,
)
from activeslam_gym.slam.depth_particles import particles_of
from activeslam_gym.slam.detection import DETECTION, UNASSOCIATED
from activeslam_gym.slam.estimate import Estimate, EstimateArrays, empty_estimates, taken_estimate
from activeslam_gym.slam.kalman import predict, update
from activeslam_gym.slam.map import (
    add_landmark,
    convert_and_delete,
    count_misses,
    initialisation_of,
    initialise,
    remove_feature,
)
from activeslam_gym.slam.restart import restart_of
from activeslam_gym.slam.sight import PREDICTED, Sight, sight_of_belief

FILTER, filter_of = constants(
    Scenario(),
    association=association_of,
    appearance=appearance_of,
    initialisation=initialisation_of,
    particles=particles_of,
    restart=restart_of,
)
"""Constants of the filter."""
COUNTS = record(
    initialised="i8",
    conversions="i8",
    deletions="i8",
    rejected_matches="i8",
    restarts="i8",  # times that the belief was reset
)
"""Counters that a frame adds to; any record with these fields will do."""
_COVARIANCES = "symmetric, with no eigenvalue under 0"
_ROUNDING = 1e-5  # of what is given, which may be in single precision
_MODELS = record(lens=CAMERA, motion=MOTION, filter=FILTER)


class Filter:
    """The filter on its own: it takes pixels, and keeps a joint Gaussian of camera and map.

    A round is `predict`, `sight` (predicted measurements), `update` (by the detections), and `add_landmark` or `delete`
    where the map should grow or shrink. Ids never change: a feature's is positive, fiducial k's -1 - k.

    Args:
        scenario: Its lens, noise, motion model and constants of the filter; ``landmark_count`` + 13 features at most.
        fiducials: (K, 3) points of known position [m].
        camera: (13,) first mean: position, quaternion (scalar first), velocity, angular velocity; None: the scenario's.
        covariance: (12, 12) of its tangent: position, rotation (world frame), velocity, angular velocity; None: the
            scenario's.
        boxes: (B, 2, 3) lowest and highest corners [m] of the boxes that are known to occlude.

    Raises:
        ValueError: an array is not of its shape, not finite, or impossible.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        fiducials: Any = None,
        camera: Any = None,
        covariance: Any = None,
        boxes: Any = None,
    ) -> None:
        scenario = scenario or Scenario()
        first, prior = start_of(scenario)
        self.models = filled(
            _MODELS, lens=camera_of(scenario), motion=motion_of(scenario, 1.0), filter=filter_of(scenario)
        )
        self.camera = self.models.lens
        self.belief = row(empty_beliefs(scenario, 1), 0)
        self.fiducials = _array("fiducials", fiducials, np.zeros((0, 3)), (None, 3))
        self.boxes = _array("boxes", boxes, np.zeros((0, 2, 3)), (None, 2, 3))
        self.counts = np.zeros(1, COUNTS)[0]
        self._sight: Sight | None = None
        self._arrays = row(empty_estimates(self.capacity, 1), 0)
        if not (self.boxes[:, 0] < self.boxes[:, 1]).all():
            raise ValueError(f"boxes must have a lowest corner and a highest one, got {boxes!r}")
        mean, P = _camera("camera", camera, first), _covariance("covariance", covariance, prior, CAMERA_DIM)
        reset_belief(self.belief, mean, P)

    def predict(self, u: Any = None, dt: float | None = None, drift: float = 0.0) -> None:
        """``dt`` seconds ahead (None: the scenario's frame) under the known accelerations ``u`` (6,), None: zero.

        ``drift``: deviation [rad] by which each feature's direction wanders while its view changes by a radian, for a
        sensor that does not see quite the same point from everywhere (`appearance.wander`).
        """
        step = float(self.models.motion.dt if dt is None else dt)
        if not 0.0 < step < np.inf:
            raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
        if not 0.0 <= drift < np.inf:
            raise ValueError(f"drift must be a number of radians that is not negative, got {drift!r}")
        predict(self.models.motion, self.belief, _array("u", u, np.zeros(6), (6,)), step, False)
        if drift > 0.0:
            wander(self.belief, float(drift), step)
        self._sight = None

    def snapshot(self) -> Belief:
        """A copy of the belief, for `restore`."""
        return copy.deepcopy(self.belief)

    def restore(self, belief: Belief) -> None:
        """Make the belief, in its arrays, which may be those of a run, that of a `snapshot`."""
        for name in belief.state.dtype.names:
            self.belief.state[name] = belief.state[name]
        for own, kept in zip(self.belief[1:], belief[1:]):
            own[...] = kept
        self._sight = None

    def attach(self, belief: Belief) -> None:
        """Work on the arrays ``belief`` of a run from now on."""
        self.belief, self._sight = belief, None

    def sight(self) -> Sight:
        """The predicted measurements: ``point`` (ids, predicted pixels, Jacobians, visibility), H P and S."""
        if self._sight is None:
            sight = sight_of_belief(self.camera, self.belief, self.fiducials, self.boxes)
            self._sight = sight._replace(point=sight.point.view(PREDICTED))  # a kernel's records have no attributes
        return self._sight

    def draw_bias(self, k: int, std: float) -> None:
        """From now on the pixel of fiducial ``k`` is off by a new bias of deviation ``std`` [px].

        See `appearance.draw_bias`.

        Raises:
            ValueError: there are more fiducials than `MOST_BIASED`, there is no fiducial ``k``, or ``std`` is no
                deviation.
        """
        K = len(self.fiducials)
        if K > MOST_BIASED:
            raise ValueError(f"at most {MOST_BIASED} fiducials may have biases, got {K}")
        if not 0 <= k < K:
            raise ValueError(f"k must be in 0 … {K - 1}, got {k!r}")
        if not 0.0 <= std < np.inf:
            raise ValueError(f"std must be zero or a positive number, got {std!r}")
        draw_bias(self.belief, K, k, std * std)
        self._sight = None

    def update(self, detections: Any, labelled: bool = False, *, jointly: bool = False, least: int = 1) -> np.ndarray:
        """Associate and update; (M,) the id that each detection was matched to, or NEW (0) or REJECTED.

        ``detections`` (M,) is an array of type DETECTION (see `detections_of`), whose ``match`` is written; several may
        bear one id. ``labelled``: the ids are certain. Features that were missed too often are deleted.

        ``jointly``: all bear ids, since each prediction was searched for around its predicted pixel, and their looks
        and places together choose the right ones (`slam.appearance`); if fewer than ``least`` agree, none is believed.
        Then the searcher counts misses and deletes. It may search some predictions, update, and then search the rest of
        the same frame by the new `sight`.

        Raises:
            ValueError: detections that are not finite, of an impossible R or id, or not as ``jointly`` wants them.
        """
        answered = np.asarray(detections)
        if answered.size and answered.dtype.names != DETECTION.names:
            raise ValueError(f"detections must be of type DETECTION, as detections_of makes them, got {detections!r}")
        given = np.array(answered, DETECTION).reshape(-1)
        if not (np.isfinite(given["pixel"]).all() and np.isfinite(given["R"]).all()):
            raise ValueError("detections must have finite pixels and covariances")
        if not (sound := _are_noises(given["R"])).all():
            raise ValueError(f"R of detections must be {_COVARIANCES}, got {given['R'][~sound].tolist()}")
        ids = set(given["id"].tolist()) - {UNASSOCIATED, *self.ids.tolist()}
        if labelled and (nothing := ids - set(map(fiducial_id, range(len(self.fiducials))))):
            raise ValueError(f"id of labelled detections must be of features or fiducials, got {sorted(nothing)}")
        models, belief, fiducials, sight = self.models, self.belief, self.fiducials, self.sight()
        if jointly:
            self._check_joint(given, labelled)
            use_identified(models, belief, fiducials, sight, given, int(least), self.counts)
        else:
            matches = associate(models, belief, self.boxes, sight, given, bool(labelled), self.counts)
            count_misses(models.filter.initialisation, belief, len(fiducials), sight, matches)
            update(models, belief, fiducials, sight, matches, given, self.counts)
            convert_and_delete(models.filter.initialisation, belief, self.counts)
        self._sight = None
        if answered.size:
            answered["match"] = given["match"].reshape(answered.shape)
        return given["match"].copy()

    def _check_joint(self, given: np.ndarray, labelled: bool) -> None:
        if labelled or np.any(given["id"] == UNASSOCIATED):
            raise ValueError("jointly chosen detections must all bear ids, which are not certain")
        if not np.isfinite(given["log_ratio"]).all():
            raise ValueError("detections must have finite log_ratio")
        if self.belief.particles.shape[1] > 0:
            raise ValueError("jointly needs a scenario whose initialisation is inverse_depth")

    def initialise(self, detections: np.ndarray) -> None:
        """Initialise features where ``detections`` (M,), after their `update`, were NEW for several frames."""
        initialise(self.models, self.belief, detections, self.counts)
        self._sight = None

    def add_landmark(self, pixel: Any, R: Any = None) -> int:
        """Add the feature seen at ``pixel`` (2,) with noise ``R`` (2, 2); its id, or 0 if there is no room."""
        z = _array("pixel", pixel, None, (2,))
        noise = _covariance("R", R, self.camera.pixel_std**2 * np.eye(2), 2)
        self._sight = None
        model = self.models.filter
        return int(add_landmark(self.camera, model.initialisation, model.particles, self.belief, z, noise))

    @property
    def expected_inverse_depth(self) -> tuple[float, float]:
        """Mean and deviation of the inverse depth of a new feature [1/m]."""
        model = self.models.filter.initialisation
        return float(model.rho_mean), float(model.rho_std)

    @expected_inverse_depth.setter
    def expected_inverse_depth(self, prior: tuple[float, float]) -> None:
        model, given = self.models.filter.initialisation, _array("expected_inverse_depth", prior, None, (2,))
        if not (given > 0.0).all():
            raise ValueError(f"expected_inverse_depth must be two positive numbers, got {prior!r}")
        model.rho_mean, model.rho_std = given

    def resume(self, camera: Any, points: Any, covariance: Any) -> np.ndarray:
        """Begin with a ``camera`` (13,) and features by inverse depth from the world's origin; (n,) their ids.

        ``points`` (n, 3): azimuth, elevation [rad] and inverse depth [1/m]. ``covariance`` (12 + 3 n)^2: joint, of the
        camera's tangent and the points.

        Raises:
            ValueError: an array is not of its shape, not finite or impossible, or there is no room for so many.
        """
        points = _array("points", points, None, (None, 3))
        n, belief = len(points), self.belief
        if not (points[:, 2] > 0.0).all():
            raise ValueError(f"points must have positive inverse depths, got {points[:, 2].tolist()}")
        if n > self.capacity:
            raise ValueError(f"points must be {self.capacity} at most, got {n}")
        P = _covariance("covariance", covariance, None, CAMERA_DIM + 3 * n)
        reset_belief(belief, _camera("camera", camera, None), P[:CAMERA_DIM, :CAMERA_DIM])
        width = KIND_DIM[INVERSE_DEPTH]
        rows = CAMERA_DIM + (width * np.arange(n)[:, None] + np.arange(AZIMUTH, width)).ravel()
        rows = np.concatenate((np.arange(CAMERA_DIM), rows))
        belief.covariance[np.ix_(rows, rows)] = P
        belief.state.count, belief.state.initialised, belief.state.dim = n, n, CAMERA_DIM + width * n
        for k, feature in enumerate(belief.feature[:n]):
            feature["mean"] = 0.0, 0.0, 0.0, *points[k]
            feature["kind"], feature["start"], feature["slot"] = INVERSE_DEPTH, CAMERA_DIM + width * k, k
            feature["id"], feature["born"], feature["seen"], feature["misses"] = k + 1, 0, 0, 0
            feature["crowded"] = -NEVER
        self._sight = None
        return self.ids

    def delete(self, id: int) -> None:
        """Delete a feature.

        Raises:
            KeyError: no feature has that id.
        """
        remove_feature(self.belief, self._place(id))
        self.counts["deletions"] += 1
        self._sight = None

    def _place(self, id: int) -> int:
        """The place of a feature in the map."""
        found = np.flatnonzero(self.ids == id)
        if not len(found):
            raise KeyError(f"there is no feature with id {id}; there are {self.ids.tolist()}")
        return int(found[0])

    def arrays(self) -> EstimateArrays:
        """The present estimate, in arrays that the next call overwrites."""
        write_estimate(self.belief, float(self.models.filter.initialisation.mapped_depth_ratio), self._arrays)
        return self._arrays

    def estimate(self) -> Estimate:
        """The present estimate."""
        return taken_estimate(self.arrays())

    @property
    def mean(self) -> np.ndarray:
        """(13,) of the camera: position, quaternion, velocity, angular velocity; a copy."""
        return self.belief.state.camera.copy()

    @property
    def camera_covariance(self) -> np.ndarray:
        """(12, 12) of the camera's tangent; a copy."""
        return self.belief.covariance[:CAMERA_DIM, :CAMERA_DIM].copy()

    def place_camera(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Give the camera a ``mean`` (13,) and a ``covariance`` (12, 12) independent of the map, which stays.

        Raises:
            ValueError: an array is not of its shape, not finite, or impossible.
        """
        belief, first = self.belief, _camera("mean", mean, None)
        P = _covariance("covariance", covariance, None, CAMERA_DIM)
        belief.state.camera[:] = first
        belief.covariance[:CAMERA_DIM, :] = 0.0
        belief.covariance[:, :CAMERA_DIM] = 0.0
        belief.covariance[:CAMERA_DIM, :CAMERA_DIM] = P
        self._sight = None

    @property
    def ids(self) -> np.ndarray:
        """(n,) of the features, oldest first."""
        return self.belief.feature["id"][: self.belief.state.count].copy()

    @property
    def capacity(self) -> int:
        """Features that there is room for."""
        return len(self.belief.feature)

    @property
    def positions(self) -> np.ndarray:
        """(n, 3) every feature as a point [m], oldest first: those of `points`, without the covariance."""
        return positions_of(self.belief)

    @property
    def mapped(self) -> np.ndarray:
        """(n,) whether each feature's depth is known, oldest first: that of `estimate`."""
        return mapped_of(self.belief, float(self.models.filter.initialisation.mapped_depth_ratio))

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Every feature as a point, (n, 3) [m], and the joint covariance of camera and points (12 + 3 n)^2."""
        estimate = self.estimate()
        return estimate.points, estimate.covariance


def detections_of(
    pixels: Any,
    R: Any = None,
    ids: Sequence[int] | np.ndarray | int = UNASSOCIATED,
    log_ratios: Any = 0.0,
    pixel_std: float = 2.0,
) -> np.ndarray:
    """Detections (M,) at ``pixels`` (M, 2), with noise ``R`` (2, 2) or (M, 2, 2); None: ``pixel_std``."""
    pixels = np.reshape(np.asarray(pixels, float), (-1, 2))
    out = np.zeros(len(pixels), DETECTION)
    out["pixel"], out["R"] = pixels, pixel_std**2 * np.eye(2) if R is None else R
    out["id"], out["log_ratio"] = ids, log_ratios
    return out


def _array(name: str, value: Any, default: np.ndarray | None, shape: tuple[int | None, ...]) -> np.ndarray:
    """``value`` (or the default where it is None) as finite numbers of that ``shape``, in which None is any length."""
    array = array_of(name, default if value is None else value, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers, got {value!r}")
    return array


def _camera(name: str, value: Any, default: np.ndarray | None) -> np.ndarray:
    """The same as a camera (13,), with a quaternion of length 1."""
    camera = _array(name, value, default, (CAMERA_SIZE,))
    if abs(np.linalg.norm(camera[QUATERNION]) - 1.0) > _ROUNDING:
        raise ValueError(f"{name} must have a quaternion of length 1, got {camera[QUATERNION].tolist()}")
    return camera


def _covariance(name: str, value: Any, default: np.ndarray | None, size: int) -> np.ndarray:
    """The same as a covariance (size, size)."""
    P = _array(name, value, default, (size, size))
    if not is_covariance(P):
        raise ValueError(f"{name} must be {_COVARIANCES}, got {value!r}")
    return P


def is_covariance(P: np.ndarray) -> bool:
    """Whether ``P`` (n, n) is symmetric without a negative eigenvalue, up to rounding."""
    size = np.sqrt(np.maximum(P.diagonal(), 1e-100))
    unit = P / (size[:, None] * size)
    return bool((np.abs(unit - unit.T) <= _ROUNDING).all() and (np.linalg.eigvalsh(unit) >= -_ROUNDING).all())


def _are_noises(R: np.ndarray) -> np.ndarray:
    """(M,) bool: the same of each of ``R`` (M, 2, 2), in a tenth of the time, since an image has many."""
    u, v, w = R[:, 0, 0], R[:, 1, 1], R[:, 0, 1]
    size = np.sqrt(np.maximum(u, 0.0) * np.maximum(v, 0.0))
    symmetric = np.abs(w - R[:, 1, 0]) <= _ROUNDING * size
    return symmetric & (u >= 0.0) & (v >= 0.0) & (np.abs(w) <= (1.0 + _ROUNDING) * size)
