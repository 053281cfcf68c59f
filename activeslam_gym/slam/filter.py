"""The filter: predict, see, associate, update, grow the map. The only order in which `slam` is used.

`Filter` is for whoever has a sensor of their own and no environment; an environment calls `filter_frame`, which is the
same steps for one belief of a batch.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym.camera import camera_of, distance_between
from activeslam_gym.config import KNOWN, Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, filled, record, row
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import CAMERA_DIM, POSITION, motion_of
from activeslam_gym.slam.appearance import appearance_of, associate_identified
from activeslam_gym.slam.association import (
    ANYTHING,
    ASSOCIATION,
    CANDIDATE,
    NEW,
    REJECTED,
    associate,
    association_of,
)
from activeslam_gym.slam.belief import (
    Belief,
    empty_beliefs,
    point_belief,
    position_of,
    positions_of,
    reset_belief,
    start_of,
    write_estimate,
)
from activeslam_gym.slam.correction import CORRECTION, correct, correction_of, product_frames
from activeslam_gym.slam.depth_particles import PARTICLES, follow_rays, particles_of
from activeslam_gym.slam.estimate import Estimate, EstimateArrays, empty_estimates, taken_estimate
from activeslam_gym.slam.estimator import EKF, ESTIMATORS, Measurements
from activeslam_gym.slam.initialisation import (
    INITIALISATION,
    delete_failed,
    follow_tracks,
    give_birth,
    initialisation_of,
    mature,
)
from activeslam_gym.slam.kalman import feel_contact, predict, wander
from activeslam_gym.slam.map import remove_feature
from activeslam_gym.slam.restart import RESTART, contradicted, restart, restart_of
from activeslam_gym.slam.sight import INSIDE, THING, Sight, sight_of_belief

FILTER = record(
    association=ASSOCIATION,
    correction=CORRECTION,
    initialisation=INITIALISATION,
    particles=PARTICLES,
    restart=RESTART,
)
"""Constants of the filter."""
COUNTS = record(
    births="i8",
    conversions="i8",
    deletions="i8",
    rejected_matches="i8",
    starvations="i8",  # frames in which most candidates, of two or more, were rejected
    recoveries="i8",  # frames in which joint matches alone, of two or more, kept this from happening
    restarts="i8",  # times that the belief was given up
)
"""What a frame did to the map: counters that it adds to."""


def filter_of(scenario: Scenario) -> Record:
    """The FILTER record of a scenario."""
    association = association_of(scenario)
    return filled(
        FILTER,
        association=association,
        correction=correction_of(scenario),
        initialisation=initialisation_of(scenario),
        particles=particles_of(scenario, association),
        restart=restart_of(scenario),
    )


@compiled
def filter_frame(
    camera: Record,
    motion: Record,
    model: Record,
    belief: Belief,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    u: np.ndarray,
    dt: float,
    candidates: np.ndarray,
    labelled: bool,
    counts: Record,
) -> None:
    """Advance the belief by one frame of ``dt`` seconds; sets ``candidates.match`` (M,), births included.

    ``u`` (6,) is what the filter knows of the accelerations, ``boxes`` what it knows to hide things. ``labelled``: the
    candidates' ids are certain; one without an id is of nothing known. ``counts`` may be any record with these fields.
    """
    predict(motion, belief, u, dt)
    sight = sight_of_belief(camera, belief, fiducials, boxes)
    use_candidates(camera, model, belief, fiducials, boxes, sight, candidates, labelled, counts)
    initialise(camera, model, belief, candidates, counts)


@compiled
def initialise(camera: Record, model: Record, belief: Belief, candidates: np.ndarray, counts: Record) -> None:
    """Initialise features at candidates (M,) that nothing explained for several frames; sets their ``match``."""
    for i in follow_tracks(camera, model.initialisation, belief, candidates):
        candidate = candidates[i]
        candidate.match = give_birth(
            camera, model.initialisation, model.particles, belief, candidate.pixel, candidate.R
        )
        counts.births += candidate.match != NEW


@compiled
def use_candidates(
    camera: Record,
    model: Record,
    belief: Belief,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    sight: Sight,
    candidates: np.ndarray,
    labelled: bool,
    counts: Record,
) -> None:
    """Associate, update, count misses, turn features into points and delete those that failed.

    Where the fiducials contradict the belief, it is begun anew instead.
    """
    pixel_var, v, M = camera.pixel_std**2, sight.thing.shape[0], candidates.shape[0]
    waits, jointly = np.zeros(v, np.bool_), 0
    if labelled:
        of_thing = match_by_id(sight, candidates)
    else:
        of_thing, jointly = associate(model.association, pixel_var, sight, candidates, belief.state.count, waits)
    if belief.particles.shape[1] > 0:
        follow_rays(camera, model.particles, belief, boxes, candidates, labelled)
    rejected = 0
    for i in range(M):
        rejected += candidates[i].match == REJECTED
    counts.rejected_matches += rejected
    counts.starvations += M >= 2 and 2 * rejected > M
    counts.recoveries += jointly >= 2 and 2 * (rejected + jointly) > M >= 2 * rejected
    if contradicted(model.restart, belief, sight, candidates, of_thing, waits, pixel_var):
        counts.deletions += belief.state.count
        counts.restarts += 1
        restart(model.restart, belief)
        for i in range(M):
            candidates[i].match = REJECTED
        return
    _count_misses(model.initialisation.miss_spacing, belief, fiducials.shape[0], sight, of_thing, waits)
    update_by(model.correction.product_frames, camera, belief, fiducials, sight, of_thing, candidates)
    counts.conversions += mature(model.initialisation, belief)
    counts.deletions += delete_failed(model.initialisation, belief)


@compiled
def use_identified(
    camera: Record,
    appearance: Record,
    model: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    candidates: np.ndarray,
    least: int,
    counts: Record,
) -> None:
    """Associate candidates that bear ids, update, and turn features into points; see `appearance`.

    No misses are counted and nothing is deleted: whoever searched knows which things it searched, and may come again in
    the same frame.
    """
    pixel_var = camera.pixel_std**2
    of_thing = associate_identified(appearance, pixel_var, sight, candidates, least)
    for i in range(candidates.shape[0]):
        counts.rejected_matches += candidates[i].match == REJECTED
    _count_misses(0.0, belief, fiducials.shape[0], sight, of_thing, np.ones(of_thing.shape[0], np.bool_))
    update_by(model.correction.product_frames, camera, belief, fiducials, sight, of_thing, candidates)
    counts.conversions += mature(model.initialisation, belief)


@compiled
def match_by_id(sight: Sight, candidates: np.ndarray) -> np.ndarray:
    """(v,) the likeliest candidate that bears each thing's id, or -1; sets ``candidates.match`` to their ids."""
    of_thing = np.full(sight.thing.shape[0], -1)
    for i in range(candidates.shape[0]):
        candidates[i].match = candidates[i].id if candidates[i].id != ANYTHING else NEW
        for a in range(of_thing.shape[0]):
            rival = of_thing[a]
            if candidates[i].id == sight.thing[a].id and (
                rival < 0 or candidates[i].log_ratio > candidates[rival].log_ratio
            ):
                of_thing[a] = i
    return of_thing


@borrowing
def _count_misses(
    spacing: float, belief: Belief, K: int, sight: Sight, of_thing: np.ndarray, waits: np.ndarray
) -> None:
    """A match clears a feature's misses; being predicted well inside the image without a candidate near adds one.

    Misses from places less than ``spacing`` [m] apart count once: what hides a feature hides it from all of them.
    """
    camera = belief.state.camera
    for a in range(of_thing.shape[0]):
        thing = sight.thing[a]
        if thing.row < K:
            continue
        feature = belief.feature[thing.row - K]
        if of_thing[a] >= 0:
            feature.misses, feature.seen = 0, belief.state.frame
        elif thing.visibility == INSIDE and not waits[a]:
            if feature.misses == 0 or spacing == 0.0 or distance_between(feature.missed_at, camera) > spacing:
                feature.misses += 1
                copy_into(feature.missed_at, camera[POSITION])


@compiled
def update_by(
    frames: float,
    camera: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    of_thing: np.ndarray,
    candidates: np.ndarray,
) -> None:
    """Correct by the matched things, each with its candidate's own R.

    The second-order noise of a feature stays what it is for so many ``frames``: as many of them tell what one does, so
    each is given as many times that noise.
    """
    m = 0
    for i in of_thing:
        m += i >= 0
    if m == 0:
        return
    things, row, pixels = np.empty(m, THING), np.empty(2 * m, np.int64), np.empty(2 * m)
    HP, S = np.empty((2 * m, sight.HP.shape[1])), np.empty((2 * m, 2 * m))
    m = 0
    for a in range(of_thing.shape[0]):
        if of_thing[a] >= 0:
            things[m] = sight.thing[a]
            for axis in range(2):
                row[2 * m + axis], pixels[2 * m + axis] = 2 * a + axis, candidates[of_thing[a]].pixel[axis]
            m += 1
    for r in range(2 * m):
        for j in range(HP.shape[1]):
            HP[r, j] = sight.HP[row[r], j]
        for c in range(2 * m):
            S[r, c] = sight.S[row[r], row[c]]
        R = candidates[of_thing[row[r] // 2]].R
        for axis in range(2):
            more = R[r % 2, axis] - (camera.pixel_std**2 if r % 2 == axis else 0.0)
            more += (frames - 1.0) * things[r // 2].extra[r % 2, axis]
            S[r, r - r % 2 + axis] += more
            things[r // 2].extra[r % 2, axis] += more
    correct(camera, belief, fiducials, Sight(things, HP, S), pixels)


class Filter:
    """The filter on its own, for any sensor: pixels go in, a joint Gaussian of camera and map is kept.

    A round is `predict`, `sight` (where to look), `update` (with what was found there), and `birth` or `delete` where
    the map should grow or shrink. Things have ids that never change: a feature's is positive, fiducial k's -1 - k.

    Args:
        scenario: Its lens, noise, motion model and constants of the filter; ``landmark_count`` + 13 features at most.
        fiducials: (K, 3) points of known position [m].
        camera: (13,) first mean: position, quaternion (scalar first), velocity, angular velocity; None: the scenario's.
        covariance: (12, 12) of its tangent: position, rotation (world frame), velocity, angular velocity; None: the
            scenario's.
        boxes: (B, 2, 3) lowest and highest corners [m] of what is known to hide things.
        products_last: Whether products of two errors hardly change from frame to frame, so that they count as noise of
            several frames, and for points too; None: where the scenario's commands are known. On images they were
            measured to be better counted once (docs/vision.md).

    Raises:
        ValueError: an array is not of its shape, or not finite.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        fiducials: Any = None,
        camera: Any = None,
        covariance: Any = None,
        boxes: Any = None,
        products_last: bool | None = None,
    ) -> None:
        scenario = scenario or Scenario()
        first, prior = start_of(scenario)
        self.camera, self.motion, self.model = camera_of(scenario), motion_of(scenario, 1.0), filter_of(scenario)
        if products_last is not None:
            self.model.correction.product_frames = product_frames(products_last)
            self.camera.point_curvature = float(products_last)
        self.appearance = appearance_of(scenario)
        self.belief = row(empty_beliefs(scenario, 1), 0)
        self.fiducials = _array("fiducials", fiducials, np.zeros((0, 3)), (-1, 3))
        self.boxes = _array("boxes", boxes, np.zeros((0, 2, 3)), (-1, 2, 3))
        self.counts = np.zeros(1, COUNTS)[0]
        self._sight: Sight | None = None
        self._arrays = row(empty_estimates(self.capacity, 1), 0)
        mean = _array("camera", camera, first, first.shape)
        reset_belief(self.belief, mean, _array("covariance", covariance, prior, prior.shape))

    def predict(self, u: Any = None, dt: float | None = None, drift: float = 0.0) -> None:
        """``dt`` seconds ahead (None: the scenario's frame) under the known accelerations ``u`` (6,), None: zero.

        ``drift``: deviation [rad] by which each feature's direction wanders while its view changes by a radian, for a
        sensor that does not see quite the same point from everywhere (`kalman.wander`).
        """
        step = float(self.motion.dt if dt is None else dt)
        if not 0.0 < step < np.inf:
            raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
        if not 0.0 <= drift < np.inf:
            raise ValueError(f"drift must be a number of radians that is not negative, got {drift!r}")
        predict(self.motion, self.belief, _array("u", u, np.zeros(6), (6,)), step)
        if drift > 0.0:
            wander(self.belief, float(drift), step)
        self._sight = None

    def attach(self, belief: Belief) -> None:
        """Work on the arrays ``belief`` of a run from now on."""
        self.belief, self._sight = belief, None

    def forget_sight(self) -> None:
        """Make `sight` anew at its next call."""
        self._sight = None

    def sight(self) -> Sight:
        """What should be in view now: ``thing`` (ids, predicted pixels, Jacobians, visibility), H P and S."""
        if self._sight is None:
            sight = sight_of_belief(self.camera, self.belief, self.fiducials, self.boxes)
            self._sight = sight._replace(thing=sight.thing.view(THING))  # a kernel's records have no attributes
        return self._sight

    def feel_contact(self, u: np.ndarray, dt: float) -> None:
        """The camera has touched something, before that frame's `predict`: see `kalman.feel_contact`."""
        feel_contact(self.belief, u, dt)

    def update(self, candidates: Any, labelled: bool = False, *, jointly: bool = False, least: int = 1) -> np.ndarray:
        """Associate and update; (M,) the id that each candidate was taken for, or NEW (0) or REJECTED.

        ``candidates`` (M,) is an array of type CANDIDATE (see `candidates_of`); several may bear one id. ``labelled``:
        the ids are certain. Features that were missed too often are forgotten.

        ``jointly``: all bear ids, since each thing was searched for where `sight` has it, and by their looks and places
        together it is chosen which are right (`slam.appearance`); if fewer than ``least`` agree, none is believed. Then
        missing and forgetting are the searcher's business, who may search some things, update, and then search the rest
        of the same frame by the new `sight`.
        """
        given = np.asarray(candidates)
        if given.size and given.dtype.names != CANDIDATE.names:
            raise ValueError(f"candidates must be of type CANDIDATE, as candidates_of makes them, got {candidates!r}")
        given = np.array(given, CANDIDATE).reshape(-1)
        if not (np.isfinite(given["pixel"]).all() and np.isfinite(given["R"]).all()):
            raise ValueError("candidates must have finite pixels and covariances")
        if jointly:
            self._update_jointly(given, labelled, least)
        else:
            use_candidates(
                self.camera,
                self.model,
                self.belief,
                self.fiducials,
                self.boxes,
                self.sight(),
                given,
                bool(labelled),
                self.counts,
            )
        self._sight = None
        return given["match"].copy()

    def _update_jointly(self, given: np.ndarray, labelled: bool, least: int) -> None:
        """See `update`."""
        if labelled or np.any(given["id"] == ANYTHING):
            raise ValueError("jointly chosen candidates must all bear ids, which are not certain")
        if not np.isfinite(given["log_ratio"]).all():
            raise ValueError("candidates must have finite log_ratio")
        if self.belief.particles.shape[1] > 0:
            raise ValueError("jointly needs a scenario whose initialisation is inverse_depth")
        camera, belief, fiducials, sight = self.camera, self.belief, self.fiducials, self.sight()
        use_identified(camera, self.appearance, self.model, belief, fiducials, sight, given, int(least), self.counts)

    def birth(self, pixel: Any, R: Any = None) -> int:
        """Add the feature seen at ``pixel`` (2,) with noise ``R`` (2, 2); its id, or 0 if there is no room."""
        z = _array("pixel", pixel, None, (2,))
        noise = _array("R", R, self.camera.pixel_std**2 * np.eye(2), (2, 2))
        self._sight = None
        return int(give_birth(self.camera, self.model.initialisation, self.model.particles, self.belief, z, noise))

    def delete(self, id: int) -> None:
        """Forget a feature.

        Raises:
            KeyError: no feature has that id.
        """
        remove_feature(self.belief, self._position(id))
        self._sight = None

    def arrays(self) -> EstimateArrays:
        """The present estimate, in arrays that the next call overwrites."""
        write_estimate(self.belief, float(self.model.initialisation.mapped_depth_ratio), self._arrays)
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
        """Give the camera a ``mean`` (13,) and a ``covariance`` (12, 12) independent of the map, which stays."""
        belief = self.belief
        belief.state.camera[:] = mean
        belief.covariance[:CAMERA_DIM, :] = 0.0
        belief.covariance[:, :CAMERA_DIM] = 0.0
        belief.covariance[:CAMERA_DIM, :CAMERA_DIM] = covariance
        self._sight = None

    @property
    def ids(self) -> np.ndarray:
        """(n,) of the features, oldest first."""
        return self.belief.feature["serial"][: self.belief.state.count].copy()

    @property
    def capacity(self) -> int:
        """Features that there is room for."""
        return len(self.belief.feature)

    @property
    def positions(self) -> np.ndarray:
        """(n, 3) every feature as a point [m], oldest first: those of `points`, without the covariance."""
        return positions_of(self.belief)

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Every feature as a point, (n, 3) [m], and the joint covariance of camera and points (12 + 3 n)^2."""
        n = int(self.belief.state.count)
        points, P = np.empty((n, 3)), np.empty((CAMERA_DIM + 3 * n, CAMERA_DIM + 3 * n))
        point_belief(self.belief, points, P)
        return points, P

    def _position(self, id: int) -> int:
        k = int(position_of(self.belief, int(id))) if id > 0 else -1
        if k < 0:
            raise KeyError(f"there is no feature with id {id}; there are {self.ids.tolist()}")
        return k


@ESTIMATORS.register(EKF)
class Ekf:
    """The compiled filter as an `Estimator`, for registered sensors whose measurements are pixels."""

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        if np.shape(sensor.noise) != (2, 2):
            raise ValueError(
                f"the estimator {EKF!r} takes measurements of two numbers, a pixel; those of scenario.sensor "
                f"{scenario.sensor!r} have {len(sensor.noise)}: register an estimator for them"
            )
        self._scenario, self._filter = scenario, Filter(scenario, fiducials=fiducials)
        self._known, self._time = scenario.association == KNOWN, 0.0

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Begin an episode."""
        reset_belief(self._filter.belief, mean, covariance)
        self._time = 0.0

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        """Go on by ``dt`` seconds."""
        if contact:
            self._filter.feel_contact(u, dt)
        self._filter.predict(u, dt)
        self._time += dt

    def update(self, measurements: Measurements) -> np.ndarray:
        """Associate, update, and initialise features."""
        filter = self._filter
        given = candidates_of(measurements.values, measurements.noise, measurements.ids)
        use_candidates(
            filter.camera, filter.model, filter.belief, filter.fiducials, filter.boxes, filter.sight(), given,
            self._known, filter.counts,
        )  # fmt: skip
        initialise(filter.camera, filter.model, filter.belief, given, filter.counts)
        filter.forget_sight()
        return given["match"].copy()

    def estimate(self) -> Estimate:
        """The present state estimate."""
        return taken_estimate(self._filter.arrays(), self._time)

    def copy(self) -> "Ekf":
        """An independent copy."""
        return copy.deepcopy(self)


def candidates_of(
    pixels: Any,
    R: Any = None,
    ids: Sequence[int] | np.ndarray | int = ANYTHING,
    log_ratios: Any = 0.0,
    pixel_std: float = 2.0,
) -> np.ndarray:
    """Candidates (M,) at ``pixels`` (M, 2), with noise ``R`` (2, 2) or (M, 2, 2); None: ``pixel_std``."""
    pixels = np.reshape(np.asarray(pixels, float), (-1, 2))
    out = np.zeros(len(pixels), CANDIDATE)
    out["pixel"], out["R"] = pixels, pixel_std**2 * np.eye(2) if R is None else R
    out["id"], out["log_ratio"] = ids, log_ratios
    return out


def _array(name: str, value: Any, default: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """``value`` (or the default where it is None) as finite numbers of that ``shape``, in which -1 is any length."""
    try:
        array = np.array(default if value is None else value, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    fits = array.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, array.shape))
    if not fits or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers of shape {shape}, got {value!r}")
    return array


ESTIMATORS.seal()
