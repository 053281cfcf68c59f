"""One image: predict, search, associate, update; then initialisations where the map is thin, and deletions.

The front end finds pixels for predicted features. The filter does not know of images, and decides alone which
candidates it believes.
"""

import math
import time
from dataclasses import replace
from statistics import median

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.association import DETECTION
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.estimate import EstimateArrays, add_offsets
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.sight import INSIDE, Sight
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.gallery import Gallery
from activeslam_gym.vision.outcome import DOUBTED, MATCHED, MISSED, NOTHING, FrameLog, Searched
from activeslam_gym.vision.redrawing import Drawn, Redrawing
from activeslam_gym.vision.relocalisation import PRIOR, locate, remember
from activeslam_gym.vision.restart import Restart
from activeslam_gym.vision.search import FOUND, UNSEARCHED, Findings, search
from activeslam_gym.vision.selection import among, most_telling, own_covariances
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_HALF
from activeslam_gym.vision.views import reduced, speeds, view_from

_LEVER = 0.5 * TEMPLATE_HALF
"""Mean distance of the edges of a corner's template from the corner: so far off is the corner found for each radian by
which the template is turned against the image [px]."""
_STEADY = 0.1
"""Where the rotation is known less well [rad], the filter's linear model of what is unknown to the map fails."""
_NEAREST = 3.0
"""What is nearer counts as so many times the scenario's inverse depth."""


class FrontEnd:
    """Feeds a filter with the matches that it finds in images."""

    def __init__(self, filter: Filter, settings: FrontEndSettings | None = None) -> None:
        self.filter, self.camera = filter, filter.camera
        self._focal, self._width, self._height = (float(self.camera[name]) for name in ("focal", "width", "height"))
        self._shape = int(self._height), int(self._width)
        self._centre = np.array((self.camera.u0, self.camera.v0))
        self.settings = (settings or FrontEndSettings()).seen_through(self._focal)
        self._models = [self.settings.search(scouting) for scouting in (False, True)]
        self._prior = filter.expected_inverse_depth
        self._gallery = Gallery(self.camera, self.settings, filter.capacity + len(filter.fiducials))
        self._frame, self._time = 0, 0.0
        self._found: list[np.ndarray] = []
        self._searched = NOTHING
        self._views: list[np.ndarray] = []
        self._blind = 0  # images in a row without the map
        self._scale = 1.0  # pixels of an image, along a side, to one of the filter's
        self._target: tuple[Redrawing, np.ndarray] | None = None
        self._restart = Restart(self.camera, filter.fiducials, self.settings.fiducial_std)

    # The start --------------------------------------------------------------------------------------------------------

    def start(self, image: np.ndarray, drawn: np.ndarray, corners: np.ndarray, normal: np.ndarray) -> None:
        """The first image (h, w): the fiducials' templates at ``corners`` (K, 2) [px] of ``drawn`` (h, w) float32, in
        the filter's pixels, on the plane with ``normal`` (3,) (world, away from the camera), and first initialisations.
        The pose comes from the corners; they do not update again."""
        image = self._reduced(image)
        for k, corner in enumerate(corners):
            self._gallery.hang(-1 - k, drawn, corner, self.filter.mean, normal, 0)
        self._found = []
        self._give_births(image, image.astype(np.float32), corners, 4 * self.settings.births)

    def show(self, target: Drawn, normal: np.ndarray, shown_from: np.ndarray | None = None) -> None:
        """The fiducials look as ``target`` draws them, on a plane with ``normal`` (3,) (world, away from the camera);
        they are drawn again whenever their view has changed, and now, unless all were ``shown_from`` a pose (7,)."""
        self._target = Redrawing(target, self.filter.fiducials, self.settings.redrawn, shown_from), normal

    def _draw_target(self, sight: Sight) -> None:
        """Draw the fiducials in ``sight`` that were drawn for another view as they should look now; those that are not
        wholly in the image keep their looks. A new drawing is found with a new bias."""
        if self._target is None:
            return
        (looks, normal), pose = self._target, self.filter.mean[:7]
        for k, picture, pixel in looks.due(-1 - sight.thing["id"], sight.thing["z_hat"], pose, self._shape):
            self._gallery.hang(-1 - k, picture, pixel, pose, normal, self._frame)
            if self.settings.fiducial_bias_std > 0.0:
                self.filter.draw_bias(k, self.settings.fiducial_bias_std)

    # A frame ----------------------------------------------------------------------------------------------------------

    @property
    def candidates(self) -> np.ndarray:
        """(M,) DETECTION: those of the last image with the filter's answer, in its pixels; new features at the end."""
        if len(self._found) > 1:
            self._found = [np.concatenate(self._found)]
        return self._found[0]

    @property
    def searched(self) -> Searched:
        """The searches of the last image, in its pixels; none before the second image."""
        own, n = self._searched, self._scale
        return own if n == 1 else own._replace(pixel=n * (own.pixel + 0.5) - 0.5, covariance=n**2 * own.covariance)

    def first_seen(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where the camera was when each of the features ``ids`` (n,) was initialised [m]; NaN if unknown."""
        places = self._gallery.places(ids)
        return np.where((places < 0)[:, None], np.nan, self._gallery.templates.camera[places, :3])

    def add_feature_bias(self, estimate: EstimateArrays) -> None:
        """Add to the covariance of each landmark of the filter's ``estimate`` how far its template may follow another
        point: a constant offset, isotropic, of ``feature_bias_std`` [px] at the distance of its first sight.

        No measurement of the filter depends on it. A planner that reads the estimate expects measurements to lower it.
        """
        ids = estimate.landmark["id"][: int(estimate.state.count)]
        add_offsets(estimate, self.first_seen(ids), self.settings.feature_bias_std / self._focal)

    def estimate(self) -> EstimateArrays:
        """The estimate of the filter with `add_feature_bias`, in arrays that the next call overwrites."""
        arrays = self.filter.arrays()
        self.add_feature_bias(arrays)
        return arrays

    def step(self, image: np.ndarray, time_s: float, u: np.ndarray | None = None) -> FrameLog:
        """Go on to the ``image`` (h, w) uint8 of ``time_s`` [s], under the known accelerations ``u`` (6,), if any."""
        began = time.thread_time()
        image = self._reduced(image)
        grey = image.astype(np.float32)
        self._frame += 1
        self._found, self._searched = [np.zeros(0, DETECTION)], NOTHING
        dt, self._time = time_s - self._time, time_s
        self.filter.predict(u, dt, self.settings.drift / self._focal)
        lost = self._blind >= self.settings.lost_after
        before = self._relocalise(grey) if lost else None
        self._look(grey)
        outcome = self._searched.outcome
        searched, found, matched = len(outcome), int((outcome != MISSED).sum()), int((outcome == MATCHED).sum())
        if before is not None and not self._suffices(matched, searched):
            self.filter.attach(before)  # the map is not there
        clear = self._notice(searched, matched)
        dropped = self._heed_target()
        births, deletions = self._learn(clear, clear or self._sees_nothing_known(searched), image, grey)
        deletions += dropped
        again, metric = before is not None and self._blind == 0, len(self.filter.fiducials) > 0
        missed = not self._suffices(matched, searched)
        counts = (self._gallery.features, searched, found, matched, found - matched, births, deletions)
        return FrameLog(time_s, *counts, clear, missed, again, metric, 1e3 * (time.thread_time() - began))

    def _reduced(self, image: np.ndarray) -> np.ndarray:
        """The level of the ``image``'s pyramid that has the size of the filter's camera."""
        ratio = image.shape[1] / self._width
        self._scale = math.floor(ratio) if ratio >= 1.0 else ratio
        return reduced(image, self._scale)

    def _notice(self, searched: int, matched: int) -> bool:
        """Whether so much of the map is in sight that features may be judged and initialised. Remembers the view, or
        counts one more image without the map."""
        s = self.settings
        if self._suffices(matched, searched):
            self._blind = 0
            remember(self._views, self.filter.mean[:7])
        elif self._blind > 0 or searched >= s.constellation:
            self._blind += 1
        enough = matched >= max(s.clear * searched, s.least_clear)
        return bool(enough and (self._blind == 0 or self._blind > s.patience))

    def _sees_nothing_known(self, searched: int) -> bool:
        """Whether so little of the map was in view, as far as is known, that its misses say nothing."""
        s = self.settings
        return searched < s.constellation and self._turn_std() < _STEADY

    def _suffices(self, matched: int, searched: int) -> bool:
        """Whether so many matches tell the pose."""
        s = self.settings
        return matched >= max(s.least_share * searched, 3 if self._blind < s.lost_after else s.regained)

    def _relocalise(self, grey: np.ndarray) -> Belief | None:
        """Seek the map in all of the image, as it looked from one of the remembered views, the newest first. The belief
        before the camera was put where the map is seen from; None: it was not."""
        s, attempt = self.settings, self._blind - self.settings.lost_after
        if not self._views or (attempt > s.patience and attempt % 5):
            return None
        ids = np.array(self._gallery.best(s.sought), np.int64)
        rows = np.where(ids < 0, -1 - ids, len(self.filter.fiducials) + np.searchsorted(self.filter.ids, ids))
        points, half = self._points(rows), 0.5 * np.array((self._width, self._height))
        everywhere = np.tile(half, (len(ids), 1)), np.tile(np.diag(2.0 * half**2 / s.gate), (len(ids), 1, 1))
        model = replace(s, scout_area=np.inf).search(scouting=True)
        view = view_from(self.camera, self._views[-1 - attempt % len(self._views)])
        found = search(view, model, self._gallery.templates, grey, self._gallery.places(ids), points, *everywhere)
        row, peak = found.candidates
        pose = locate(self.camera, ids[row], points[row], found.pixel[row, peak], s.constellation)
        if pose is None:
            return None
        before = self.filter.snapshot()
        self.filter.place_camera(np.concatenate((pose, np.zeros(6))), PRIOR)
        return before

    def _look(self, grey: np.ndarray) -> None:
        """Search the features that may be in view, and let the filter judge.

        Three fiducials or more go before all else: features whose depths are wrong alike would outvote them. Where
        ellipses are large, a few scouts go first: their matches make the others' ellipses small. So the time of a frame
        stays bounded, and outliers are fewer.
        """
        self._draw_target(self.filter.sight())
        sight, s = self.filter.sight(), self.settings
        known = sight.thing["id"].copy()
        if np.count_nonzero(known < 0) >= 3:
            self._search(sight, grey, known[known < 0], self._models[False], s.scout_share)
            sight, known = self.filter.sight(), known[known >= 0]
        scouts = self._scouts(sight)
        if scouts:
            self._search(sight, grey, np.array(scouts), self._models[True], s.scout_share)
            sight = self.filter.sight()
        others = self._most_telling(sight, known[~among(known, np.array(scouts))])
        self._search(sight, grey, others, self._models[False], s.least_share)

    def _most_telling(self, sight: Sight, wanted: np.ndarray) -> np.ndarray:
        """Of the ``wanted`` ids of ``sight``, those that there is time to search: see `selection.most_telling`."""
        thing = sight.thing
        allowed = among(thing["id"], wanted) & (self._gallery.places(thing["id"]) >= 0)
        if np.count_nonzero(allowed) <= self.settings.searched:
            return wanted
        return thing["id"][most_telling(sight.S, thing["R"] + thing["curvature"], allowed, self.settings.searched)]

    def _scouts(self, sight: Sight) -> list[int]:
        """Ids of the features to search first: none if ellipses are small, else those with the best record."""
        s, ids, z_hat = self.settings, sight.thing["id"], sight.thing["z_hat"]
        S = own_covariances(sight.S)
        areas = np.pi * s.gate * np.sqrt(np.maximum(S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] * S[:, 1, 0], 0.0))
        inside = np.all((z_hat > 20) & (z_hat < (self._width - 20, self._height - 20)), axis=1)
        known = inside & (self._gallery.places(ids) >= 0)
        if not known.any() or median(areas[known].tolist()) < s.vague_area:
            return []
        return self._gallery.best(s.scouts, ids[known].tolist())

    def _search(self, sight: Sight, grey: np.ndarray, wanted: np.ndarray, model: Record, share: float) -> None:
        """Search the ``wanted`` ids of ``sight``, and update the filter by the candidates, if a ``share`` agrees."""
        chosen, mean = among(sight.thing["id"], wanted), self.filter.mean
        thing, S = sight.thing[chosen], own_covariances(sight.S)[chosen]
        ids, z_hat, points = thing["id"], np.ascontiguousarray(thing["z_hat"]), self._points(thing["row"])
        places = self._gallery.places(ids)
        places[self._gallery.change_of_view(places, points, mean) > self.settings.most_change] = -1
        findings = search(view_from(self.camera, mean), model, self._gallery.templates, grey, places, points, z_hat, S)
        tried = findings.state != UNSEARCHED
        least = max(round(share * np.count_nonzero(tried)), 3 if self._blind >= self.settings.lost_after else 1)
        candidates = self._candidates(ids, places, findings)
        candidates["match"] = matched = self.filter.update(candidates, jointly=True, least=least)
        self._gallery.remember_looks(matched, points, mean, findings)
        self._found.append(candidates)
        outcome = np.where(among(ids, matched), MATCHED, np.where(findings.state == FOUND, DOUBTED, MISSED))
        inside = thing["visibility"] == INSIDE
        now = (column[tried] for column in (ids, z_hat, S, outcome, inside))
        self._searched = Searched(*map(np.concatenate, zip(self._searched, now)))

    def _points(self, rows: np.ndarray) -> np.ndarray:
        """World points (v, 3) of the fiducials and features at ``rows`` (v,) of a sight."""
        return np.concatenate((self.filter.fiducials, self.filter.positions))[rows]

    def _candidates(self, ids: np.ndarray, places: np.ndarray, findings: Findings) -> np.ndarray:
        """The findings of the predictions ``ids`` (v,), whose templates are at ``places`` (v,), as candidates (M,); new
        features pull little: some follow an edge."""
        s, (row, peak) = self.settings, findings.candidates
        out = np.zeros(row.shape[0], DETECTION)
        id, pixel, R = ids[row], findings.pixel[row, peak], findings.R[row, peak]
        fiducial = id < 0
        if fiducial.any():
            R[fiducial] = self._noise_of_fiducials(-1 - id[fiducial], R[fiducial])
        R[~self._gallery.proven(places[row])] *= s.probation**2 if len(self.filter.fiducials) else 1.0
        lens = s.lens_std * (2.0 * np.hypot(*(pixel - self._centre).T) / self._width) ** 2
        astray = s.residual_weight * self._gallery.residuals(places[row])
        R += (lens**2)[:, None, None] * np.eye(2)
        R += astray[:, :, None] * astray[:, None, :]
        out["id"], out["pixel"], out["R"] = id, pixel, R
        out["log_ratio"] = s.score_weight * (findings.score[row, peak] - s.match_score)
        return out

    def _noise_of_fiducials(self, k: np.ndarray, R: np.ndarray) -> np.ndarray:
        """R (n, 2, 2) of the matched fiducials ``k`` (n,), from that of features."""
        s, turn = self.settings, self._turn_std() ** 2
        fit = (s.fiducial_grain / s.grain if s.grain > 0.0 else 0.0) * (R - s.floor_std**2 * np.eye(2))
        blur = s.fiducial_blur * speeds(self.camera, self.filter.mean, self.filter.fiducials[k])
        return fit + (s.fiducial_std**2 + _LEVER**2 * turn + blur**2)[:, None, None] * np.eye(2)

    def _turn_std(self) -> float:
        """Deviation of the camera's rotation about an axis [rad]."""
        return math.sqrt(np.trace(self.filter.camera_covariance[D_ROTATION, D_ROTATION]) / 3.0)

    # The map ----------------------------------------------------------------------------------------------------------

    def _learn(self, clear: bool, fertile: bool, image: np.ndarray, grey: np.ndarray) -> tuple[int, int]:
        """Delete features if the image is ``clear``, and initialise new ones if it is ``fertile``."""
        sight, searched = self.filter.sight(), self._searched
        points = self._points(sight.thing["row"])
        if clear:
            self._gallery.judge(searched.id, searched.outcome == MATCHED, searched.inside, self._frame)
            self._gallery.remember_residuals(self.candidates, sight)
        places = self._gallery.places(sight.thing["id"])
        change = self._gallery.change_of_view(places, points, self.filter.mean)
        failed = {*self._gallery.failed(), *sight.thing["id"][self._gallery.strained(places, change)].tolist()}
        for id in sorted(failed):
            self._forget(id)
        if not fertile:
            return 0, len(failed)
        places = self._gallery.places(sight.thing["id"])
        occupied = sight.thing["z_hat"][(places >= 0) & (change <= self.settings.most_change)]
        return self._give_births(image, grey, occupied, self.settings.births), len(failed)

    def _heed_target(self) -> int:
        """Restart at the pose that the target shows, where it contradicts the belief: how many features are deleted."""
        instead = self._restart.camera_instead(self.candidates, self.filter.mean, self.filter.camera_covariance)
        if instead is None:
            return 0
        for id in (ids := self.filter.ids.tolist()):
            self._forget(id)
        self.filter.place_camera(*instead)
        self._views.clear()
        return len(ids)

    def _forget(self, id: int) -> None:
        self._gallery.remove(id)
        self.filter.delete(id)

    def _expect_depths(self) -> None:
        """New features are expected as far away as fiducials and mapped ones are now.

        Each feature's prior counts as one more measurement of the scale. Where it is wrong by a little for all of them,
        as a desk's is in a room, the map's scale is soon wrong by more than it knows. Where there are no fiducials, the
        scale is free.
        """
        weight, (mean, std) = self.settings.depth_prior, self._prior
        points = np.concatenate((self.filter.positions[self.filter.mapped], self.filter.fiducials))
        distances = np.linalg.norm(points - self.filter.mean[:3], axis=1)
        rho = 1.0 / np.maximum(distances, 1.0 / (_NEAREST * mean))
        total = weight + len(rho)
        centre = (weight * mean + rho.sum()) / total
        square = (weight * (std**2 + (mean - centre) ** 2) + ((rho - centre) ** 2).sum()) / total
        spread = max(math.sqrt(square), self.settings.least_depth_spread * centre)
        self.filter.expected_inverse_depth = centre, spread

    def _give_births(self, image: np.ndarray, grey: np.ndarray, occupied: np.ndarray, most: int) -> int:
        """New features, at the ``most``, where the image has few; when the map is full, or of unknown depths, those not
        seen for longest make room."""
        s, (h, w), edge = self.settings, image.shape, TEMPLATE_HALF + 2
        in_view = int(np.all((occupied >= edge) & (occupied < (w - edge, h - edge)), axis=1).sum())
        wanted = min(most, s.visible - in_view)
        due = self._frame % s.births_every == 0 or 2 * in_view < s.visible
        if wanted <= 0 or not due:
            return 0
        if math.isfinite(s.depth_prior) and len(self.filter.fiducials) > 0:
            self._expect_depths()
        born, count = np.zeros(wanted, DETECTION), 0
        for pixel in new_corners(image, occupied, wanted, s.spacing, edge + 6, s.least_corner, s.least_ratio):
            ids, full = self.filter.ids, self._gallery.features >= self.filter.capacity
            rivals = ids if full else ids[self.filter.vague]
            if full or len(rivals) >= s.most_vague:
                oldest = self._gallery.longest_unseen(rivals, self._frame - 3)
                if oldest is None or in_view + count >= s.room_below:
                    break
                self._forget(oldest)
            id = self.filter.birth(pixel)
            if id > 0:
                self._gallery.hang(id, grey, pixel, self.filter.mean, np.zeros(3), self._frame)
                born[count]["match"], born[count]["pixel"] = id, pixel
                count += 1
        self._found.append(born[:count])
        if len(self.filter.fiducials) > 0:
            self.filter.share_depths(born["match"][:count], s.depth_in_common)
        return count
