"""One image: predict, search, associate, update; then births where the map is thin and deletions where it failed.

The front end is one more way to find pixels for predicted features: the filter does not know of images, and decides
alone which candidates it believes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record, filled
from activeslam_gym.slam.association import CANDIDATE, REJECTED
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.sight import INSIDE, Sight
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.relocalisation import Views, locate, replace_camera, whole_image
from activeslam_gym.vision.search import FOUND, PEAKS, SEARCH, UNSEARCHED, Findings, search
from activeslam_gym.vision.templates import TEMPLATE_HALF, empty_templates, store
from activeslam_gym.vision.views import change_of_view


@dataclass(frozen=True)
class FrontEndSettings:
    """What is searched, believed, added and dropped."""

    gate: float = 11.8
    """Ellipses are searched to this squared Mahalanobis distance: 3 sigma, 99.7 % [-]."""
    least_score: float = 0.8
    """Least normalised cross-correlation of a candidate."""
    largest_area: float = 4000.0
    """Larger ellipses are not searched [px]."""
    vague_area: float = 1500.0
    """If the median ellipse is larger, scouts are searched first [px]."""
    scout_area: float = 20000.0
    """Of a larger ellipse, a scout searches the middle part of this size [px]."""
    least_share: float = 0.2
    """If a smaller share of the searched belongs together, nothing is believed: strangers agree now and then."""
    scout_share: float = 0.4
    """The same of the scouts."""
    scouts: int = 10
    """How many go first."""
    floor_std: float = 0.3
    """Pixel noise of a perfect template: what lens and plane leave unexplained, correlated in time [px]."""
    grain: float = 10.0
    """Inflation of the covariance of the sub-pixel fit."""
    fiducial_std: float = 0.3
    """The same of a fiducial, whose template is drawn [px]."""
    lens_std: float = 1.0
    """What the lens model leaves at half the image's width from the centre, growing with the radius squared [px]."""
    view_std: float = 0.0
    """What a plane leaves unexplained where a feature is seen from another side or distance than at first: for each
    radian, and each e-fold of the distance [px]."""
    most_change: float = 2.0
    """A feature that is seen more differently than that is not searched, and may have a younger one beside it [rad]."""
    warp: bool = True
    """Whether templates are warped to the present view."""
    subpixel: bool = True
    """Whether matches are refined below the pixel."""
    appearance: bool = True
    """Whether the score of a match counts in the association."""
    match_score: float = 0.8
    """Score at which a match and a stranger are equally likely."""
    score_weight: float = 25.0
    """Growth of the log likelihood ratio with the score."""
    visible: int = 32
    """Features wanted in view."""
    births: int = 4
    """Most births of a frame."""
    births_every: int = 3
    """Frames from one look for corners to the next, unless fewer than half of the wanted are in view."""
    spacing: float = 13.0
    """Distance of a birth from other features [px]."""
    least_corner: float = 4e-4
    """Least corner strength of a birth."""
    trials: int = 10
    """A feature is judged after so many searches ..."""
    least_success: float = 0.5
    """... and deleted when a smaller share of them was matched."""
    most_residual: float = 1.0
    """A feature whose pixels are that far, on average, from where the updated belief has it, is deleted: an edge before
    something far behind, or a moving picture [px]."""
    memory: float = 0.9
    """Share of a feature's record that is left after one more search."""
    clear: float = 0.5
    """A frame in which a smaller share of the searched is matched is blurred: it judges no feature and bears none."""
    least_clear: int = 3
    """So is one in which fewer are matched."""
    room_below: int = 32
    """In a full map, features not seen for longest make room while fewer are in view."""
    recover: bool = True
    """Whether ``least_share`` is demanded, scouts go first where ellipses are large, and a lost map is sought."""
    lost_after: int = 3
    """Images, one after the other, in which next to nothing that should be there is found, until the map is lost and is
    sought in the whole image."""
    patience: int = 20
    """Such images until features are judged and born again, come what may."""
    sought: int = 20
    """Features that are sought, those with the best record."""
    constellation: int = 7
    """So many must be where one pose has them."""


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
        self._near, self._far = _search_of(s, scouting=False), _search_of(s, scouting=True)
        rows = filter.capacity + len(filter.fiducials)
        self.templates = empty_templates(rows)
        self._place: dict[int, int] = {}
        self._tried, self._matched = np.zeros(rows), np.zeros(rows)
        self._residual = np.zeros((rows, 2))
        self._seen = np.zeros(rows, np.int64)
        self._frame = 0
        self._time = 0.0
        self._found: list[np.ndarray] = []
        self._searched: list[Searched] = []
        self._views, self._blind = Views([]), 0

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
            self.know(k, drawn, corner, self.filter.belief.state.camera, normal)
        self._time = time
        for _ in range(4):
            self._give_births(image, grey, corners)

    def know(self, k: int, picture: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray) -> None:
        """Fiducial ``k`` looks as at ``pixel`` (2,) of ``picture`` (h, w) float32, which is seen from ``camera``
        (>= 7,) and shows a plane with ``normal`` (3,) (world, away from the camera)."""
        self._store(-1 - k, picture, pixel, camera, normal)

    # A frame ----------------------------------------------------------------------------------------------------------

    @property
    def candidates(self) -> np.ndarray:
        """(M,) CANDIDATE: what was found in the last image, and what became of it; births at the end."""
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
        self._found, self._searched = [np.zeros(0, CANDIDATE)], []
        dt, self._time = time_s - self._time, time_s
        self.filter.predict(u, dt)
        lost = self._blind >= self.settings.lost_after
        placed = lost and self.settings.recover and self._relocalise(grey)
        looked = self._look(grey)
        searched, found, matched = len(looked.searched), len(looked.found), len(looked.matched)
        self._notice(searched, matched)
        clear = bool(matched >= max(self.settings.clear * searched, self.settings.least_clear))
        clear &= self._blind == 0 or self._blind > self.settings.patience
        sight = self.filter.sight()
        if clear:
            self._judge(looked)
            self._remember_residuals(sight)
        deletions = self._delete_failed()
        births = self._give_births(image, grey, self._occupied(sight)) if clear else 0
        return FrameLog(
            time_s,
            len(self._place) - len(self.filter.fiducials),
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

    def _notice(self, searched: int, matched: int) -> None:
        """Whether the map is still in sight: a view to remember, or one more image without it."""
        s = self.settings
        if matched >= max(s.least_share * searched, 3):
            self._blind = 0
            self._views.remember(self.filter.belief.state.camera[:7])
        elif self._blind > 0 or searched >= s.constellation:
            self._blind += 1

    def _relocalise(self, grey: np.ndarray) -> bool:
        """Seek the map in all of the image, as it looked from one of the remembered views; True: the camera was put
        where it is seen from."""
        s, attempt = self.settings, self._blind - self.settings.lost_after
        if not self._views.poses or (attempt > s.patience and attempt % 5):
            return False
        view = self._views.nth(attempt)
        ids = np.array(sorted(self._place, key=lambda id: -self._matched[self._place[id]])[: s.sought], np.int64)
        places, points = np.array([self._place[int(id)] for id in ids], np.int64), self._points(ids)
        wide = _search_of(replace(s, scout_area=np.inf), scouting=True)
        found = search(
            self.camera, wide, self.templates, grey, view, places, points, *whole_image(self.camera, len(ids), s.gate)
        )
        row, peak = np.nonzero(np.arange(PEAKS) < found.peaks[:, None])
        pose = locate(self.camera, ids[row], points[row], found.pixel[row, peak], s.constellation)
        if pose is not None:
            replace_camera(self.filter.belief, pose)
        return pose is not None

    def _look(self, grey: np.ndarray) -> Looked:
        """Search what may be in view, and let the filter judge.

        Where ellipses are large, a few scouts go first: what they find makes the others' ellipses small. So the time of
        a frame stays bounded, and a stranger has less room.
        """
        sight = self.filter.sight()
        known = [int(id) for id in sight.thing["id"] if int(id) in self._place]
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
        known = [(a, int(id)) for a, id in enumerate(sight.thing["id"]) if int(id) in self._place and inside[a]]
        if not known or np.median([areas[a] for a, _ in known]) < s.vague_area:
            return []
        known.sort(key=lambda row: -self._matched[self._place[row[1]]])
        return [id for _, id in known[: s.scouts]]

    def _search(self, sight: Sight, grey: np.ndarray, wanted: list[int], model: Record) -> Looked:
        """Search the rows of ``sight`` whose ids are ``wanted``, and update the filter by what is found."""
        at, ids, pose = set(wanted), sight.thing["id"], self.filter.belief.state.camera
        places = np.array([self._place[int(id)] if int(id) in at else -1 for id in ids], np.int64)
        z_hat, S = np.ascontiguousarray(sight.thing["z_hat"]), _own_covariances(sight)
        points = self._points(ids)
        change = self._change_of_view(places, points)
        places[change > self.settings.most_change] = -1
        findings = search(self.camera, model, self.templates, grey, pose, places, points, z_hat, S)
        tried = findings.state != UNSEARCHED
        share = self.settings.scout_share if model.shrink else self.settings.least_share
        least = round(share * np.count_nonzero(tried)) if self.settings.recover else 1
        candidates = self._candidates(ids, findings, change)
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

    def _change_of_view(self, places: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(v,) how differently the features at ``places`` (v,), now at ``points`` (v, 3), are seen from when first; the
        target, whose plane is known, never is."""
        first, now = self.templates.camera[places, :3], self.filter.belief.state.camera[:3]
        return np.where((places < 0) | (self.templates.id[places] < 0), 0.0, change_of_view(first, now, points))

    def _candidates(self, ids: np.ndarray, findings: Findings, change: np.ndarray) -> np.ndarray:
        """The findings of the things ``ids`` (v,), seen so differently (v,), as candidates (M,)."""
        row, peak = np.nonzero(np.arange(PEAKS) < findings.peaks[:, None])
        out = np.zeros(row.shape[0], CANDIDATE)
        out["id"] = ids[row]
        out["pixel"] = findings.pixel[row, peak]
        s = self.settings
        out["R"] = findings.R[row, peak]
        out["R"] += ((s.view_std * change[row]) ** 2)[:, None, None] * np.eye(2)
        out["R"][out["id"] < 0] += (s.fiducial_std**2 - s.floor_std**2) * np.eye(2)
        radius = np.hypot(out["pixel"][:, 0] - self.camera.u0, out["pixel"][:, 1] - self.camera.v0)
        lens = s.lens_std * (2.0 * radius / self.camera.width) ** 2
        out["R"] += (lens**2)[:, None, None] * np.eye(2)
        out["log_ratio"] = s.score_weight * (findings.score[row, peak] - s.match_score) if s.appearance else 0.0
        return out

    # The map ----------------------------------------------------------------------------------------------------------

    def _judge(self, looked: Looked) -> None:
        """Remember which of the searched features were matched; a miss counts where it is telling."""
        for id in looked.searched:
            place, hit = self._place[id], id in looked.matched
            if hit:
                self._seen[place] = self._frame
            if hit or id in looked.telling:
                self._tried[place] = self.settings.memory * self._tried[place] + 1.0
                self._matched[place] = self.settings.memory * self._matched[place] + hit

    def _remember_residuals(self, sight: Sight) -> None:
        """How far the matched pixels are from where the updated belief has them, each feature's running mean."""
        at = {int(id): z for id, z in zip(sight.thing["id"], sight.thing["z_hat"])}
        keep = self.settings.memory
        for found in self._found:
            for id, pixel in zip(found["match"].tolist(), found["pixel"]):
                if id in at:
                    self._residual[self._place[id]] *= keep
                    self._residual[self._place[id]] += (1.0 - keep) * (pixel - at[id])

    def _delete_failed(self) -> int:
        """Delete the features that were searched often and found seldom, or not where they should be."""
        s = self.settings
        enough = (1.0 - s.memory**s.trials) / (1.0 - s.memory)
        seldom = (self._tried >= enough) & (self._matched < s.least_success * self._tried)
        astray = np.hypot(*self._residual.T) > s.most_residual
        failed = (seldom | astray) & (self.templates.id > 0)
        for place in np.flatnonzero(failed):
            self._forget(int(self.templates.id[place]))
        return int(failed.sum())

    def _forget(self, id: int) -> None:
        place = self._place.pop(id)
        self.templates.id[place] = 0
        self.filter.delete(id)

    def _occupied(self, sight: Sight) -> np.ndarray:
        """(m, 2) predicted pixels of what is in view and searched."""
        thing = sight.thing[[int(id) in self._place for id in sight.thing["id"]]]
        places = np.array([self._place[int(id)] for id in thing["id"]], np.int64)
        change = self._change_of_view(places, self._points(thing["id"]))
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
        born = np.zeros(wanted, CANDIDATE)
        count = 0
        for pixel in new_corners(image, occupied, wanted, s.spacing, edge + 6, s.least_corner):
            if self._is_full() and not (in_view + count < s.room_below and self._make_room()):
                break
            id = self.filter.birth(pixel)
            if id > 0:
                self._store(id, grey, pixel, self.filter.belief.state.camera, np.zeros(3))
                born[count]["match"], born[count]["pixel"] = id, pixel
                count += 1
        self._found.append(born[:count])
        return count

    def _is_full(self) -> bool:
        return int(np.count_nonzero(self.templates.id > 0)) >= self.filter.capacity

    def _make_room(self) -> bool:
        """Delete the feature that was not seen for the longest time, unless all are in view."""
        in_map = np.flatnonzero(self.templates.id > 0)
        oldest = in_map[self._seen[in_map].argmin()]
        if self._seen[oldest] >= self._frame - 3:
            return False
        self._forget(int(self.templates.id[oldest]))
        return True

    def _store(self, id: int, grey: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray) -> None:
        """Keep the template of a feature or fiducial first seen at ``pixel`` (2,) from ``camera`` (>= 7,)."""
        place = int(np.flatnonzero(self.templates.id == 0)[0])
        self._place[id] = place
        self._tried[place], self._matched[place], self._seen[place] = 0.0, 0.0, self._frame
        self._residual[place] = 0.0
        store(self.camera, self.templates, place, id, grey, np.asarray(pixel, float), camera, normal)


def _search_of(settings: FrontEndSettings, scouting: bool) -> Record:
    """The SEARCH record of the settings; scouts look into the middle of ellipses that are too large."""
    s = settings
    return filled(
        SEARCH,
        gate=s.gate,
        least_score=s.least_score,
        largest_area=s.scout_area if scouting else s.largest_area,
        shrink=scouting,
        floor_std=s.floor_std,
        grain=s.grain,
        warp=s.warp,
        subpixel=s.subpixel,
    )


def _own_covariances(sight: Sight) -> np.ndarray:
    """(v, 2, 2) each row's own block of the joint S."""
    v = len(sight.thing)
    return sight.S.reshape(v, 2, v, 2)[np.arange(v), :, np.arange(v), :]
