"""One image: predict, search, associate, update; then births where the map is thin and deletions where it failed.

The front end is one more way to find pixels for predicted features: the filter does not know of images, and decides
alone which candidates it believes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.association import DETECTION, REJECTED
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.sight import INSIDE, Sight
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.gallery import Gallery
from activeslam_gym.vision.relocalisation import Views, locate, replace_camera, whole_image
from activeslam_gym.vision.search import FOUND, PEAKS, UNSEARCHED, Findings, search
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_HALF, shows_template
from activeslam_gym.vision.views import change_of_view, turn_between


class FrameLog(NamedTuple):
    """What happened in a frame."""

    time: float
    """[s]"""
    features: int
    """In the map after the frame."""
    searched: int
    found: int
    """With at least one candidate."""
    matched: int
    rejected: int
    """Found and not believed."""
    births: int
    deletions: int
    clear: bool
    """Whether so much of the searched was matched that features could be judged and born."""
    relocalised: bool
    """Whether the map was lost, and found again in this image."""
    metric: bool
    """Whether the scale is known: there are fiducials."""
    milliseconds: float
    """Of computation."""


Drawn = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From a camera's pose (7,), the picture (h, w) float32 of the target, NaN where nobody knows, and the pixels (K, 2) of
its fiducials; a ValueError: it is not before the camera."""

_LEVER = 0.5 * TEMPLATE_HALF
"""How far the edges of a corner's template are from the corner, in the mean: so far off is the corner found for each
radian by which the template is turned against the image [px]."""
MISSED, MATCHED, DOUBTED = 0, 1, 2
"""What became of a search: nothing like it was found; the filter believed it; the filter did not."""


class Searched(NamedTuple):
    """Where m things were searched in the last image, and what became of it."""

    id: np.ndarray
    """(m,)"""
    pixel: np.ndarray
    """(m, 2) as predicted [px]."""
    covariance: np.ndarray
    """(m, 2, 2) of that [px^2]."""
    outcome: np.ndarray
    """(m,) MISSED, MATCHED or DOUBTED."""


class Looked(NamedTuple):
    """What a search gave, by ids."""

    sight: Sight
    searched: list[int]
    found: list[int]
    """With at least one candidate."""
    matched: set[int]
    """Believed by the filter."""
    telling: set[int]
    """Searched and well inside the image."""

    def __add__(self, other: Looked) -> Looked:  # type: ignore[override]
        """Both: scouts and the others."""
        return Looked(
            other.sight,
            self.searched + other.searched,
            self.found + other.found,
            self.matched | other.matched,
            self.telling | other.telling,
        )


class FrontEnd:
    """Feeds a filter with what it finds in images."""

    def __init__(self, filter: Filter, settings: FrontEndSettings | None = None) -> None:
        self.filter = filter
        self.settings = s = settings or FrontEndSettings()
        self.camera = filter.camera
        self._near, self._far = s.search(scouting=False), s.search(scouting=True)
        self._gallery = Gallery(self.camera, s, filter.capacity + len(filter.fiducials))
        self._frame = 0
        self._time = 0.0
        self._found: list[np.ndarray] = []
        self._searched: list[Searched] = []
        self._views, self._blind = Views([]), 0
        self._target: tuple[Drawn, np.ndarray] | None = None
        self._drawn_from: np.ndarray | None = None
        self._drawn_at = 0

    # The start --------------------------------------------------------------------------------------------------------

    def start(
        self, image: np.ndarray, drawn: np.ndarray, corners: np.ndarray, normal: np.ndarray, time: float = 0.0
    ) -> None:
        """The first image (h, w): the fiducials' templates at ``corners`` (K, 2) [px] of ``drawn`` (h, w) float32 on
        the plane with ``normal`` (3,) (world, away from the camera), and first births. The corners have told the pose;
        they do not update again."""
        image = np.ascontiguousarray(image)
        grey = image.astype(np.float32)
        for k, corner in enumerate(corners):
            self.know(k, drawn, corner, self.filter.mean, normal)
        self._time = time
        for _ in range(4):
            self._give_births(image, grey, corners)

    def know(self, k: int, picture: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray) -> None:
        """Fiducial ``k`` looks as at ``pixel`` (2,) of ``picture`` (h, w) float32, which is seen from ``camera``
        (>= 7,) and shows a plane with ``normal`` (3,) (world, away from the camera)."""
        self._gallery.hang(-1 - k, picture, pixel, camera, normal, self._frame)

    def show(self, target: Drawn, normal: np.ndarray) -> None:
        """The fiducials look as ``target`` draws them, on a plane with ``normal`` (3,) (world, away from the camera);
        they are drawn anew as often as they are seen otherwise."""
        self._target, self._drawn_from = (target, normal), None

    def _draw_target(self, sight: Sight) -> None:
        """Draw the fiducials as they should look now, if some are in ``sight`` and were drawn for another view; those
        that are not wholly in the image keep their looks."""
        pose = self.filter.mean[:7]
        if self._target is None or not (sight.thing["id"] < 0).any() or not self._is_new(pose):
            return
        target, normal = self._target
        try:
            picture, pixels = target(pose)
        except ValueError:
            return
        whole = [shows_template(picture, pixel) for pixel in pixels]
        for k in np.flatnonzero(whole).tolist():
            self.know(k, picture, pixels[k], pose, normal)
        if all(whole):
            self._drawn_from, self._drawn_at = pose, self._frame

    def _is_new(self, pose: np.ndarray) -> bool:
        """Whether the target is seen otherwise from ``pose`` (7,) than from where it was drawn."""
        last = self._drawn_from
        if last is None:
            return True
        middle = self.filter.fiducials.mean(axis=0)[None]
        change = float(change_of_view(last[:3], pose[:3], middle)[0])
        return max(change, turn_between(last[3:], pose[3:])) > self.settings.redrawn

    # A frame ----------------------------------------------------------------------------------------------------------

    @property
    def candidates(self) -> np.ndarray:
        """(M,) DETECTION: what was found in the last image, and what became of it; births at the end."""
        return np.concatenate(self._found)

    @property
    def searched(self) -> Searched:
        """Where the last image was searched, and what became of it; nothing before the second image."""
        none = Searched(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, np.int64))
        return Searched(*map(np.concatenate, zip(none, *self._searched)))

    def step(self, image: np.ndarray, time_s: float, u: np.ndarray | None = None) -> FrameLog:
        """Go on to the ``image`` (h, w) uint8 of ``time_s`` [s], under the known accelerations ``u`` (6,), if any."""
        began = time.process_time()
        image = np.ascontiguousarray(image)
        grey = image.astype(np.float32)
        self._frame += 1
        self._found, self._searched = [np.zeros(0, DETECTION)], []
        dt, self._time = time_s - self._time, time_s
        self.filter.predict(u, dt, self.settings.drift / self.camera.focal)
        lost = self._blind >= self.settings.lost_after
        placed = lost and self.settings.recover and self._relocalise(grey)
        looked = self._look(grey)
        searched, found, matched = len(looked.searched), len(looked.found), len(looked.matched)
        clear = self._notice(searched, matched)
        births, deletions = self._learn(looked, clear, image, grey)
        return FrameLog(
            time_s,
            self._gallery.features,
            searched,
            found,
            matched,
            found - matched,
            births,
            deletions,
            clear,
            bool(placed and self._blind == 0),
            len(self.filter.fiducials) > 0,
            1e3 * (time.process_time() - began),
        )

    def _notice(self, searched: int, matched: int) -> bool:
        """Whether the map is still in sight: a view to remember, or one more image without it. True: so much of it is
        that features may be judged and born."""
        s = self.settings
        if matched >= max(s.least_share * searched, 3):
            self._blind = 0
            self._views.remember(self.filter.mean[:7])
        elif self._blind > 0 or searched >= s.constellation:
            self._blind += 1
        enough = matched >= max(s.clear * searched, s.least_clear)
        return bool(enough and (self._blind == 0 or self._blind > s.patience))

    def _relocalise(self, grey: np.ndarray) -> bool:
        """Seek the map in all of the image, as it looked from one of the remembered views; True: the camera was put
        where it is seen from."""
        s, attempt = self.settings, self._blind - self.settings.lost_after
        if not self._views.poses or (attempt > s.patience and attempt % 5):
            return False
        view = self._views.nth(attempt)
        ids = np.array(self._gallery.best(s.sought), np.int64)
        places, points = self._gallery.places(ids), self._points(ids)
        wide, everywhere = replace(s, scout_area=np.inf).search(True), whole_image(self.camera, len(ids), s.gate)
        found = search(self.camera, wide, self._gallery.templates, grey, view, places, points, *everywhere)
        row, peak = np.nonzero(np.arange(PEAKS) < found.peaks[:, None])
        pose = locate(self.camera, ids[row], points[row], found.pixel[row, peak], s.constellation)
        if pose is not None:
            replace_camera(self.filter, pose)
        return pose is not None

    def _look(self, grey: np.ndarray) -> Looked:
        """Search what may be in view, and let the filter judge.

        Where ellipses are large, a few scouts go first: what they find makes the others' ellipses small. So the time of
        a frame stays bounded, and a stranger has less room.
        """
        sight = self.filter.sight()
        self._draw_target(sight)
        known = [int(id) for id in sight.thing["id"] if int(id) in self._gallery]
        scouts = self._scouts(sight) if self.settings.recover else []
        if not scouts:
            return self._search(sight, grey, known, self._near)
        looked = self._search(sight, grey, scouts, self._far)
        others = [id for id in known if id not in scouts]
        return looked + self._search(self.filter.sight(), grey, others, self._near)

    def _scouts(self, sight: Sight) -> list[int]:
        """Ids of the features to search first: none if ellipses are small, else those with the best record."""
        s = self.settings
        areas = np.pi * s.gate * np.sqrt(np.maximum(np.linalg.det(_own_covariances(sight)), 0.0))
        w, h = self.camera.width, self.camera.height
        inside = np.all((sight.thing["z_hat"] > 20) & (sight.thing["z_hat"] < (w - 20, h - 20)), axis=1)
        known = [(a, int(id)) for a, id in enumerate(sight.thing["id"]) if int(id) in self._gallery and inside[a]]
        if not known or np.median([areas[a] for a, _ in known]) < s.vague_area:
            return []
        return self._gallery.best(s.scouts, [id for _, id in known])

    def _search(self, sight: Sight, grey: np.ndarray, wanted: list[int], model: Record) -> Looked:
        """Search the rows of ``sight`` whose ids are ``wanted``, and update the filter by what is found."""
        ids, pose = sight.thing["id"], self.filter.mean
        places = np.where(np.isin(ids, wanted), self._gallery.places(ids), -1)
        z_hat, S = np.ascontiguousarray(sight.thing["z_hat"]), _own_covariances(sight)
        points = self._points(ids)
        change = self._gallery.change_of_view(places, points, pose[:3])
        places[change > self.settings.most_change] = -1
        findings = search(self.camera, model, self._gallery.templates, grey, pose, places, points, z_hat, S)
        tried = findings.state != UNSEARCHED
        share = self.settings.scout_share if model.shrink else self.settings.least_share
        least = round(share * np.count_nonzero(tried)) if self.settings.recover else 1
        candidates = self._candidates(ids, findings)
        matched = self.filter.update(candidates, jointly=True, least=max(least, 1))
        candidates["match"] = matched
        self._found.append(candidates)
        believed = np.isin(ids, matched[matched != REJECTED])
        outcome = np.where(believed, MATCHED, np.where(findings.state == FOUND, DOUBTED, MISSED))
        self._searched.append(Searched(ids[tried].copy(), z_hat[tried], S[tried], outcome[tried]))
        return Looked(
            sight,
            ids[tried].tolist(),
            ids[findings.state == FOUND].tolist(),
            set(matched[matched != REJECTED].tolist()),
            set(ids[tried & (sight.thing["visibility"] == INSIDE)].tolist()),
        )

    def _points(self, ids: np.ndarray) -> np.ndarray:
        """World points (v, 3) of the features and fiducials ``ids`` (v,)."""
        known, positions = self.filter.ids, self.filter.positions
        at = {int(id): k for k, id in enumerate(known)}
        out = np.empty((ids.shape[0], 3))
        for a, id in enumerate(ids):
            out[a] = positions[at[int(id)]] if id > 0 else self.filter.fiducials[-1 - id]
        return out

    def _candidates(self, ids: np.ndarray, findings: Findings) -> np.ndarray:
        """The findings of the things ``ids`` (v,) as candidates (M,)."""
        row, peak = np.nonzero(np.arange(PEAKS) < findings.peaks[:, None])
        out = np.zeros(row.shape[0], DETECTION)
        out["id"] = ids[row]
        out["pixel"] = findings.pixel[row, peak]
        s = self.settings
        out["R"] = findings.R[row, peak]
        fiducial = out["id"] < 0
        out["R"][fiducial] = self._noise_of_fiducials(out["R"][fiducial])
        radius = np.hypot(out["pixel"][:, 0] - self.camera.u0, out["pixel"][:, 1] - self.camera.v0)
        lens = s.lens_std * (2.0 * radius / self.camera.width) ** 2
        out["R"] += (lens**2)[:, None, None] * np.eye(2)
        out["log_ratio"] = s.score_weight * (findings.score[row, peak] - s.match_score) if s.appearance else 0.0
        return out

    def _noise_of_fiducials(self, R: np.ndarray) -> np.ndarray:
        """R (n, 2, 2) of matched fiducials, from what it would be of features."""
        s, turn = self.settings, np.trace(self.filter.camera_covariance[D_ROTATION, D_ROTATION]) / 3.0
        fit = (s.fiducial_grain / s.grain if s.grain > 0.0 else 0.0) * (R - s.floor_std**2 * np.eye(2))
        age = 0 if self._target is None else self._frame - self._drawn_at
        stare = (1.0 + age / s.looks) ** 2  # then 1 / R sums up to looks / R
        return stare * (fit + s.fiducial_std**2 * np.eye(2)) + _LEVER**2 * turn * np.eye(2)

    def first_seen(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where the camera was when each of the features ``ids`` (n,) was initialised [m]; NaN if unknown."""
        places = self._gallery.places(ids)
        return np.where((places < 0)[:, None], np.nan, self._gallery.templates.camera[places, :3])

    # The map ----------------------------------------------------------------------------------------------------------

    def _learn(self, looked: Looked, clear: bool, image: np.ndarray, grey: np.ndarray) -> tuple[int, int]:
        """What the image tells of the features, and new ones if it is ``clear``: births and deletions."""
        sight = self.filter.sight()
        if clear:
            self._gallery.judge(looked.searched, looked.matched, looked.telling, self._frame)
            for found in self._found:
                self._gallery.remember_residuals(found, sight)
        failed = self._gallery.failed()
        for id in failed:
            self._forget(id)
        births = self._give_births(image, grey, self._occupied(sight)) if clear else 0
        return births, len(failed)

    def _forget(self, id: int) -> None:
        self._gallery.remove(id)
        self.filter.delete(id)

    def _occupied(self, sight: Sight) -> np.ndarray:
        """(m, 2) predicted pixels of what is in view and searched."""
        thing = sight.thing[[int(id) in self._gallery for id in sight.thing["id"]]]
        points, now = self._points(thing["id"]), self.filter.mean[:3]
        change = self._gallery.change_of_view(self._gallery.places(thing["id"]), points, now)
        return thing["z_hat"][change <= self.settings.most_change]

    def _give_births(self, image: np.ndarray, grey: np.ndarray, occupied: np.ndarray) -> int:
        """New features where the image has few; when the map is full, those not seen for longest make room."""
        s = self.settings
        h, w = image.shape
        edge = TEMPLATE_HALF + 2
        in_view = int(np.all((occupied >= edge) & (occupied < (w - edge, h - edge)), axis=1).sum())
        wanted = min(s.births, s.visible - in_view)
        due = self._frame % s.births_every == 0 or 2 * in_view < s.visible
        if wanted <= 0 or not due:
            return 0
        born = np.zeros(wanted, DETECTION)
        count = 0
        for pixel in new_corners(image, occupied, wanted, s.spacing, edge + 6, s.least_corner, s.least_ratio):
            full = self._gallery.features >= self.filter.capacity
            if full and not (in_view + count < s.room_below and self._make_room()):
                break
            id = self.filter.birth(pixel)
            if id > 0:
                self._gallery.hang(id, grey, pixel, self.filter.mean, np.zeros(3), self._frame)
                born[count]["match"], born[count]["pixel"] = id, pixel
                count += 1
        self._found.append(born[:count])
        return count

    def _make_room(self) -> bool:
        """Delete the feature that was not seen for the longest time, unless all are in view."""
        oldest = self._gallery.longest_unseen(self._frame - 3)
        if oldest is not None:
            self._forget(oldest)
        return oldest is not None


def _own_covariances(sight: Sight) -> np.ndarray:
    """(v, 2, 2) each row's own block of the joint S."""
    v = len(sight.thing)
    return sight.S.reshape(v, 2, v, 2)[np.arange(v), :, np.arange(v), :]
