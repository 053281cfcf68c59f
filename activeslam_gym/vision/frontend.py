"""One image: predict, search, associate, update; then initialisations where the map is thin, and deletions.

The front end finds pixels for predicted features; the filter, without the image, decides which it believes.
"""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import filled
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.detection import DETECTION
from activeslam_gym.slam.estimate import EstimateArrays, add_offsets
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.sight import INSIDE
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.recovery import LEAST, PRIOR, Restart, drawn_templates, likeliest_corners, locate
from activeslam_gym.vision.search import MATCHED, NOTHING, SEARCH, Findings, Photograph, Searched, search, windows
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE, TemplateMap, shows_template
from activeslam_gym.vision.views import delayed, is_outdated, point_at, reduced, speeds, velocities, view_from


class FrameLog(NamedTuple):
    """The events of a frame: a row of frames.csv."""

    time: float  # [s]
    features: int  # in the map after the frame
    searched: int
    found: int  # with at least one candidate
    matched: int
    rejected: int  # found and not believed
    initialised: int
    deletions: int  # features that failed, or that the target contradicted
    clear: bool  # so much of the searched was matched that features could be judged and initialised
    lost: bool  # too little of the map was matched to tell the pose
    relocalised: bool  # the map was lost, and found again in this image
    metric: bool  # the scale is known: there are fiducials
    milliseconds: float  # of computation
    start_certain: bool = True  # the first motion is certain, as with a target, and the map agrees with the images


Drawn = Callable[[np.ndarray, int], tuple[np.ndarray, np.ndarray]]
"""From a camera's pose (7,) and the number of a fiducial, the picture (h, w) float32 of the target around it, NaN where
it is unknown, and its pixel (2,); a ValueError: it is not before the camera, or too little is known of it."""
_UNKNOWN = np.zeros(3)  # normal of a plane that is not known
_AROUND = 3.0  # around a corner in which a lost map is searched [px]
_NEAR = 0.06  # share of the largest area that is searched where the map is lost: its views are sought anywhere
_NEAREST = 3.0  # times the scenario's inverse depth: that of all that is nearer
_OVERLOOKED = 0.5  # share of the target's corners that are missed, from which it is sought around them
_GAP = 1.0 / 3.0, 2.5  # time [s] and frames between two images, from both of which on a hand may be anywhere
_MOST = 0.75  # share of the searched features that must be matched after a gap: in wide gates some agree by chance


class FrontEnd:
    """Feeds a filter with the matches that it finds in images."""

    def __init__(self, filter: Filter, settings: FrontEndSettings | None = None) -> None:
        self.filter, self.camera = filter, filter.camera
        self._focal, self._width = float(self.camera.focal), float(self.camera.width)
        self._centre = np.array((self.camera.u0, self.camera.v0))
        self.settings = (settings or FrontEndSettings()).seen_through(self._focal)
        self._gate = float(filter.models.filter.appearance.search_gate)
        self._model = filled(SEARCH, self.settings, gate=self._gate)
        self._near = filled(SEARCH, self.settings, gate=self._gate, largest_area=_NEAR * self.settings.largest_area)
        self._prior = filter.expected_inverse_depth
        self._template_map = TemplateMap(self.camera, self.settings, filter.capacity + len(filter.fiducials))
        self._frame, self._time = 0, 0.0
        self.repeated, self.displaced, self.strayed = 0, 0, 0.0
        """Images so far that repeat the one before; features that made room for new ones in a full map; and residuals
        of the features that the last searched image has deleted, see `TemplateMap` [px]."""
        self.candidates = np.zeros(0, DETECTION)
        """(M,) those of the last image with the filter's answer, in its pixels; new features at the end."""
        self.searched = NOTHING
        """The searches of the last image, in its pixels; none before the second image."""
        self._image = np.zeros((int(self.camera.height), int(self.camera.width)), np.uint8)  # the last, reduced
        self._grey = self._image.astype(np.float32)
        self._last_view: np.ndarray | None = None  # pose (7,) from which the map was seen last
        self._photograph: Photograph | None = None  # of which that is a part
        self._overlooked = 0.0  # running share of the target's corners well in view that are not matched
        self._blind = 0  # images in a row without the map
        self._after_gap = False  # the map was not seen since a gap in time
        self._scale = 1.0  # pixels of an image, along a side, to one of the filter's
        self._target: Drawn | None = None
        self._restart = Restart(self.camera, filter.fiducials, self.settings.fiducial_std)

    # The start --------------------------------------------------------------------------------------------------------

    def start(
        self, image: np.ndarray, time_s: float, ids: np.ndarray, pixels: np.ndarray,
        drawn: np.ndarray | None = None, normal: np.ndarray = _UNKNOWN,
    ) -> None:  # fmt: skip
        """Begin with the ``image`` (h, w) uint8 of ``time_s`` [s], and the filter's belief of it.

        It shows the features ``ids`` (n,), or fiducials -1 - k, at the ``pixels`` (n, 2) of the filter. Their templates
        are cut from it, or from the picture ``drawn`` (h, w) float32, on planes with ``normal`` (3,) (world, away from
        the camera; zeros: unknown). First features are initialised beside them.
        """
        self._take(image)
        self._time, self._last_view = time_s, self.filter.mean[:7]
        for id, pixel in zip(ids.tolist(), pixels):
            self._template_map.add(id, self._grey if drawn is None else drawn, pixel, self.filter.mean, normal, 0)
        self._initialise_features(pixels, 4 * self.settings.initialised)

    def first_log(self, milliseconds: float) -> FrameLog:
        """The log of the first image, in which nothing is searched, and which took so many ``milliseconds``."""
        return self._unsearched(self._time, 1e-3 * milliseconds)._replace(initialised=self._template_map.features)

    def _unsearched(self, time_s: float, seconds: float) -> FrameLog:
        """The log of an image of ``time_s`` [s] in which nothing was searched, and which took so many ``seconds``."""
        counts, metric = (self._template_map.features, 0, 0, 0, 0, 0, 0), len(self.filter.fiducials) > 0
        return FrameLog(time_s, *counts, True, False, False, metric, 1e3 * seconds)

    def show(self, target: Drawn, normal: np.ndarray, shown_from: np.ndarray | None = None) -> None:
        """The fiducials look as ``target`` draws them, on a plane with ``normal`` (3,) (world, away from the camera);
        they are drawn again whenever their view has changed, and now, unless all were ``shown_from`` a pose (7,)."""
        self._target, self._normal = target, normal
        self._drawn_from = np.full((len(self.filter.fiducials), 7), np.nan if shown_from is None else shown_from)

    def _draw_target(self, points: np.ndarray) -> None:
        """Draw the fiducials among the predicted ``points`` that were drawn for another view as they should look now;
        one of which too little can be drawn keeps its looks. A new drawing is found with a new bias."""
        if (target := self._target) is None:
            return
        pose = self.filter.mean[:7]
        for k in -1 - points["id"][points["id"] < 0]:
            if is_outdated(self._drawn_from[k], pose, self.filter.fiducials[k], self.settings.redrawn):
                with suppress(ValueError):
                    picture, pixel = target(pose, int(k))
                    if shows_template(picture, pixel):
                        self._drawn_from[k] = pose
                        self._template_map.add(int(-1 - k), picture, pixel, pose, self._normal, self._frame)
                        if self.settings.fiducial_bias_std > 0.0:
                            self.filter.draw_bias(int(k), self.settings.fiducial_bias_std)

    # A frame ----------------------------------------------------------------------------------------------------------

    def first_seen(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where the camera was when each of the features ``ids`` (n,) was initialised [m]; NaN if unknown."""
        places = self._template_map.places(ids)
        return np.where((places < 0)[:, None], np.nan, self._template_map.templates.camera[places, :3])

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

    def step(self, image: np.ndarray | Photograph, time_s: float, u: np.ndarray | None = None) -> FrameLog:
        """Go on to the ``image`` (h, w) uint8 of ``time_s`` [s], under the known accelerations ``u`` (6,), if any.

        One that repeats the last image shows the camera where it was then, and is no measurement of where it is. Of a
        photograph, of the size of the filter's camera, only what is looked at is worked out.
        """
        began, s, last = time.thread_time(), self.settings, self._image
        self._photograph = image if isinstance(image, Photograph) else None
        if not isinstance(image, Photograph):
            self._take(image)
            if self._blind == 0 and np.array_equal(self._image, last):
                self.repeated += 1
                return self._unsearched(time_s, time.thread_time() - began)
        self._frame += 1
        dt, self._time = time_s - self._time, time_s
        if self._last_view is not None and dt > self.longest_step:
            self._blind, self._after_gap = s.lost_after, True
        self.filter.predict(u, dt, self.settings.drift / self._focal)
        before = self.filter.snapshot() if self._after_gap else self._relocalise()
        self._search()
        again = before is not None and not self._after_gap
        if before is not None and not again and not self._is_seen:  # it is not where it was expected
            self.filter.restore(before)
            if again := self._relocalise() is not None:
                self._search()
        (searched, found, matched), seen = self.searched.counts, self._is_seen
        if before is not None and not seen:
            self.filter.restore(before)  # the map is not there
        if seen:
            self._blind, self._last_view, self._after_gap = 0, self.filter.mean[:7], False
        elif self._blind > 0 or searched >= s.constellation:
            self._blind += 1
        clear = self._blind == 0 or (self._blind > s.trials and not self._after_gap)
        dropped = self._heed_target()
        initialised, deletions, self.strayed = self._learn() if clear else (0, 0, 0.0)
        metric, features, deletions = len(self.filter.fiducials) > 0, self._template_map.features, deletions + dropped
        counts = features, searched, found, matched, found - matched, initialised, deletions
        agrees, seconds = not self._restart.is_contradicted, time.thread_time() - began
        return FrameLog(time_s, *counts, clear, not seen, again and seen, metric, 1e3 * seconds, agrees)

    def _take(self, image: np.ndarray) -> None:
        """Go on to the level of the ``image``'s pyramid that has the size of the filter's camera."""
        ratio = image.shape[1] / self._width
        self._scale = math.floor(ratio) if ratio >= 1.0 else ratio
        self._image = reduced(image, self._scale)
        self._grey = self._image.astype(np.float32)

    def _look_at(self, windows: np.ndarray | None = None) -> None:
        """Have these ``windows`` (n, 4) of a photograph, or the whole, worked out before they are read."""
        if self._photograph is not None:
            self._take(self._photograph.whole if windows is None else self._photograph.show(windows))

    @property
    def longest_step(self) -> float:
        """Time between two images, beyond which there is a gap [s]."""
        return max(_GAP[0], _GAP[1] * float(self.filter.models.motion.dt))

    @property
    def _is_lost(self) -> bool:
        return self._blind >= self.settings.lost_after

    @property
    def _is_seen(self) -> bool:
        """Whether the last search matched so many that they determine the pose."""
        searched, _, matched = self.searched.counts
        least = self.settings.constellation if self._is_lost else 3
        return matched >= max(least, _MOST * searched if self._after_gap else 0)

    def _relocalise(self) -> Belief | None:
        """Seek a lost map at the corners of the image as it looked when it was seen last. The belief before the camera
        was put where the map is seen from; None: it was not."""
        s, is_due = self.settings, self._after_gap or self._blind % self.settings.lost_after == 0
        if not (self._is_lost and is_due) or self._last_view is None:
            return None
        self._look_at()
        ids = self._template_map.ids()
        rows = np.where(ids < 0, -1 - ids, len(self.filter.fiducials) + np.searchsorted(self.filter.ids, ids))
        points, places = self._points(rows), self._template_map.places(ids)
        view, templates = view_from(self.camera, self._last_view), self._template_map.templates
        which, z_hat = likeliest_corners(self._image, drawn_templates(view, templates, places, points))
        ids, points, places = ids[which], points[which], places[which]
        S = np.tile(_AROUND**2 / self._gate * np.eye(2), (len(ids), 1, 1))
        found = search(view, self._model, templates, self._grey, places, points, z_hat, S)
        row, peak = found.candidates
        pose = locate(self.camera, ids[row], points[row], found.pixel[row, peak], s.constellation)
        if pose is None:
            return None
        before = self.filter.snapshot()
        self.filter.place_camera(np.concatenate((pose, np.zeros(6))), PRIOR)
        return before

    def _search(self) -> None:
        """Search what may be in view, and update the filter by the candidates, if enough agree."""
        s, mean = self.settings, self.filter.mean
        self._draw_target(self.filter.sight().point)
        sight = self.filter.sight()
        point, v = sight.point, np.arange(len(sight.point))
        ids, z_hat, points = point["id"], np.ascontiguousarray(point["z_hat"]), self._points(point["row"])
        S, places = sight.S.reshape(len(v), 2, len(v), 2)[v, :, v, :], self._template_map.places(ids)
        places[self._template_map.change_of_view(places, points, mean) > s.most_change] = -1
        z_hat = z_hat + (delays := delayed(self.camera, mean, points, z_hat, s.readout))
        view, templates = view_from(self.camera, mean), self._template_map.templates
        model, least = (self._near, 3) if self._is_lost else (self._model, 1)
        self._look_at(windows(model, self._grey, z_hat[places >= 0], S[places >= 0]))
        findings = search(view, model, templates, self._grey, places, points, z_hat, S)
        self.candidates = self._candidates(ids, places, findings)
        self.candidates["pixel"] -= delays[findings.candidates[0]]
        self.candidates["match"] = matched = self.filter.update(self.candidates, jointly=True, least=least)
        row, peak = (some[matched > 0] for some in findings.candidates)
        self._template_map.fit_planes(view, self._grey, places[row], points[row], findings.pixel[row, peak])
        believed = np.any(ids[:, None] == matched, axis=1)
        n = self._scale
        columns = ids, n * (z_hat + 0.5) - 0.5, n**2 * S, findings.outcome(believed), point["visibility"] == INSIDE
        self.searched = Searched(*(column[findings.searched] for column in columns))

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
            speed = speeds(self.camera, self.filter.mean, self.filter.fiducials[-1 - id[fiducial]])
            more = s.fiducial_std**2 - s.floor_std**2 + (s.blur * speed) ** 2
            R[fiducial] += more[:, None, None] * np.eye(2)
        if not len(self.filter.fiducials):
            points = self.filter.positions[np.searchsorted(self.filter.ids, id)]
            blur = s.blur * velocities(self.camera, self.filter.mean, points)
            R += blur[:, :, None] * blur[:, None, :]
        R[~self._template_map.proven(places[row])] *= s.probation**2 if len(self.filter.fiducials) else 1.0
        lens = s.lens_std * (2.0 * np.hypot(*(pixel - self._centre).T) / self._width) ** 2
        astray = s.residual_weight * self._template_map.residual[places[row]]
        lasting = s.lasting_std**2 * self._template_map.alike[places[row]]
        R += (lens**2 + lasting)[:, None, None] * np.eye(2)
        R += astray[:, :, None] * astray[:, None, :]
        out["id"], out["pixel"], out["R"] = id, pixel, R
        out["log_ratio"] = s.score_weight * (findings.score[row, peak] - s.least_score)
        return out

    # The map ----------------------------------------------------------------------------------------------------------

    def _learn(self) -> tuple[int, int, float]:
        """Initialise new features and delete those that fail: how many, and how far these had strayed [px]."""
        sight, searched = self.filter.sight(), self.searched
        points = self._points(sight.point["row"])
        self._template_map.judge(searched.id, searched.outcome == MATCHED, searched.inside, self._frame)
        self._template_map.remember_residuals(self.candidates, sight)
        failed = self._template_map.failed()
        for id in failed:
            self._forget(id)
        places = self._template_map.places(sight.point["id"])
        change = self._template_map.change_of_view(places, points, self.filter.mean)
        occupied = sight.point["z_hat"][(places >= 0) & (change <= self.settings.most_change)]
        return self._initialise_features(occupied, self.settings.initialised), len(failed), self._template_map.strayed

    def _heed_target(self) -> int:
        """Restart at the pose that the target shows, where it contradicts the belief: how many features are deleted."""
        self._seek_target()
        instead = self._restart.camera_instead(self.candidates, self.filter.mean, self.filter.camera_covariance)
        if instead is None:
            return 0
        for id in (ids := self.filter.ids.tolist()):
            self._forget(id)
        self.filter.place_camera(*instead)
        self.filter.counts["restarts"] += 1
        self._last_view, self._after_gap = None, False
        return len(ids)

    def _seek_target(self) -> None:
        """Seek a target that is missed where it should be well in view, outside the gates of its corners: the greater a
        contradiction, the fewer of them are matched."""
        s, searched = self.settings, self.searched
        corners = (searched.id < 0) & searched.inside
        if s.target_reach == 0.0 or corners.sum() < LEAST:
            return
        self._overlooked += (float(np.mean(searched.outcome[corners] != MATCHED)) - self._overlooked) / s.trials
        if self._overlooked < _OVERLOOKED:
            return
        point = self.filter.sight().point
        point = point[(point["id"] < 0) & (point["visibility"] == INSIDE)]
        ids, points, places = point["id"], self._points(point["row"]), self._template_map.places(point["id"])
        z_hat = np.ascontiguousarray(point["z_hat"])
        S = np.tile(s.target_reach**2 / self._gate * np.eye(2), (len(ids), 1, 1))
        view, templates = view_from(self.camera, self.filter.mean), self._template_map.templates
        findings = search(view, self._model, templates, self._grey, places, points, z_hat, S)
        found = self._candidates(ids, places, findings)[findings.candidates[1] == 0]
        self._restart.look_elsewhere(found, self.filter.mean, 1.0 / s.trials)

    def _forget(self, id: int) -> None:
        self._template_map.remove(id)
        self.filter.delete(id)

    def _expect_depths(self) -> None:
        """New features are expected as far away as fiducials and mapped ones are now.

        Each feature's prior counts as one more measurement of the scale, which is free without fiducials. Where it is
        wrong by a little for all, as a desk's is in a room, the map's scale is soon wrong by more than it knows.
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

    def _initialise_features(self, occupied: np.ndarray, most: int) -> int:
        """At most so many new features where the image has few; in a full map those not seen for longest make room."""
        s, (h, w), edge = self.settings, self._image.shape, TEMPLATE_HALF + 2
        in_view = int(np.all((occupied >= edge) & (occupied < (w - edge, h - edge)), axis=1).sum())
        wanted = min(most, s.visible - in_view)
        if wanted < s.initialised:
            return 0
        self._look_at()
        if math.isfinite(s.depth_prior):
            self._expect_depths()
        born, count, camera, mean = np.zeros(wanted, DETECTION), 0, self.camera, self.filter.mean
        for pixel in new_corners(self._image, occupied, wanted, TEMPLATE_SIDE, edge + 6, s.least_corner):
            if self._template_map.features >= self.filter.capacity:
                oldest = self._template_map.longest_unseen(self.filter.ids, self._frame - s.lost_after)
                if oldest is None or in_view + count >= s.least_visible:
                    break
                self._forget(oldest)
                self.displaced += 1
            ahead = point_at(camera, mean, pixel, self.filter.expected_inverse_depth[0])
            id = self.filter.add_landmark(pixel - delayed(camera, mean, ahead, pixel[None], s.readout)[0])
            if id > 0:
                self._template_map.add(id, self._grey, pixel, self.filter.mean, _UNKNOWN, self._frame)
                born[count]["match"], born[count]["pixel"] = id, pixel
                count += 1
        self.candidates = np.concatenate((self.candidates, born[:count]))
        return count
