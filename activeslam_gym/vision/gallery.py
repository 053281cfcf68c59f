"""The front end's memory of each feature: a template with the view of its first sight, and a running record."""

from collections.abc import Iterable
from statistics import median
from typing import Any

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.slam.curvature import IMAGE_PRODUCT_FRAMES
from activeslam_gym.slam.sight import Sight
from activeslam_gym.vision.search import Findings
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import empty_templates, store, tilt
from activeslam_gym.vision.views import changes_of_view, view_from

_ODD = 4.0  # times the median residual of all features, from which one alone is astray
_LONG = 0.98  # share of the mean of long that is left after one more match: it spans fifty


class Gallery:
    """Features and fiducials by id: a template and a record of each. A fiducial is never judged.

    Args:
        camera: CAMERA, the lens.
        settings: Of how a feature fails.
        rows: Features and fiducials that there is room for.
    """

    def __init__(self, camera: Record, settings: FrontEndSettings, rows: int) -> None:
        self.templates = empty_templates(rows)
        self._camera, self._settings = camera, settings
        self._place: dict[int, int] = {}
        self._tried, self._matched, self._residual = np.zeros(rows), np.zeros(rows), np.zeros((rows, 2))
        self._enough = (1.0 - settings.memory**settings.trials) / (1.0 - settings.memory)  # record of so many trials
        self._seen, self._since = np.zeros(rows, np.int64), np.zeros(rows, np.int64)  # last image, and first of a run
        self._tilted_from = np.zeros((rows, 3))
        self._strain = np.zeros((rows, 3, 4))  # mean of late, of long, and mean square of their difference

    @property
    def features(self) -> int:
        """How many, fiducials left out."""
        return int(np.count_nonzero(self.templates.id > 0))

    def hang(
        self, id: int, grey: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray, frame: int
    ) -> None:
        """Keep the looks of a feature or fiducial first seen at ``pixel`` (2,) of ``grey`` (h, w) float32 from
        ``camera`` (>= 7,); ``normal`` (3,): its plane's in the world, away from the camera, or zeros if unknown. One
        that hangs already gets new looks, and keeps its record."""
        if id not in self._place:
            self._place[id] = place = int(np.flatnonzero(self.templates.id == 0)[0])
            for record in (self._tried, self._matched, self._residual, self._strain):
                record[place] = 0.0
            self._seen[place] = self._since[place] = frame
        self._tilted_from[self._place[id]] = camera[:3]
        view, slope_std = view_from(self._camera, camera), self._settings.slope_std
        store(view, self.templates, self._place[id], id, grey, np.asarray(pixel, float), normal, slope_std)

    def remove(self, id: int) -> None:
        """Delete a feature."""
        self.templates.id[self._place.pop(id)] = 0

    def places(self, ids: Any) -> np.ndarray:
        """(v,) the rows of the templates of ``ids`` (v,); -1: it has none."""
        return np.array([self._place.get(id, -1) for id in np.asarray(ids).tolist()], np.int64)

    def best(self, count: int, of: Iterable[int] | None = None) -> list[int]:
        """Those ``count`` of the ids ``of`` (None: of all) that were matched most of late."""
        return sorted(self._place if of is None else of, key=lambda id: -self._matched[self._place[id]])[:count]

    def change_of_view(self, places: np.ndarray, points: np.ndarray, now: np.ndarray) -> np.ndarray:
        """(v,) the change of view of the features at ``places`` (v,), now at ``points`` (v, 3), from their first sight
        to ``now`` (3,); zero for the target, whose plane is known."""
        change = changes_of_view(self.templates.camera[places], now, points)
        return np.where((places < 0) | (self.templates.id[places] < 0), 0.0, change)

    def judge(self, ids: Iterable[int], matched: np.ndarray, inside: np.ndarray, frame: int) -> None:
        """Remember of the searched ``ids`` (m,) which were ``matched`` (m,); a miss counts where the feature is well
        ``inside`` (m,) the image."""
        places, keep = self.places(ids), self._settings.memory
        again = places[matched & (frame - self._seen[places] > self._settings.trials)]
        self._since[again] = frame
        self._seen[places[matched]] = frame
        told = matched | inside
        self._tried[places[told]] = keep * self._tried[places[told]] + 1.0
        self._matched[places[told]] = keep * self._matched[places[told]] + matched[told]

    def remember_residuals(self, found: np.ndarray, sight: Sight) -> None:
        """The running mean, of each feature, of its matched pixel in ``found`` (M,) DETECTION less its pixel in the
        ``sight`` of the updated estimate; of that the share which is noise, and not error of the linearisation, where
        the filter counts that several times: else it would count twice."""
        row, k = np.nonzero(found["match"][:, None] == sight.thing["id"])
        found, thing = found[row], sight.thing[k]
        keep, frames = self._settings.memory, IMAGE_PRODUCT_FRAMES if self._camera.command_known else 0.0
        noise, neglected = np.trace(found["R"], 0, 1, 2), frames * np.trace(thing["curvature"], 0, 1, 2)
        weight = (1.0 - keep) * (noise / np.maximum(noise + neglected, 1e-12))[:, None]
        places = self.places(found["match"])
        self._residual[places] = keep * self._residual[places] + weight * (found["pixel"] - thing["z_hat"])

    def remember_looks(self, matched: np.ndarray, points: np.ndarray, now: np.ndarray, found: Findings) -> None:
        """Learn of the planes of those that were ``matched`` (M,), of the candidates in ``found``, from ``now`` (3,):
        how the halves of their templates have moved, and, where the view is new, their slopes. ``points`` (v, 3) are
        the world points of the rows of ``found``.

        In one view the error of a template is the same in every image: many tell no more than one.
        """
        row, peak = found.candidates
        right = matched > 0
        places, row, peak = self.places(matched[right]), row[right], peak[right]
        self._remember_strain(places, found.strain[row, peak])
        new = changes_of_view(self._tilted_from[places], now, points[row]) > self._settings.tilt_every
        places, row, peak = places[new], row[new], peak[new]
        for place, change, cov in zip(places.tolist(), found.slope[row, peak], found.slope_cov[row, peak]):
            tilt(self.templates, place, change, cov)
        self._tilted_from[places] = now[:3]

    def _remember_strain(self, places: np.ndarray, strain: np.ndarray) -> None:
        """How differently the halves of the matched templates at ``places`` (m,) have moved: ``strain`` (m, 4) [px]."""
        late = self._settings.memory
        own = self._strain[places]
        first = ~own.any(axis=(1, 2))
        own[first, :2] = strain[first, None]
        own[:, 0] = late * own[:, 0] + (1.0 - late) * strain
        own[:, 1] = _LONG * own[:, 1] + (1.0 - _LONG) * own[:, 0]
        own[:, 2] = _LONG * own[:, 2] + (1.0 - _LONG) * (own[:, 0] - own[:, 1]) ** 2
        self._strain[places] = own

    def strained(self, places: np.ndarray, change: np.ndarray) -> np.ndarray:
        """(v,) which of the features at ``places`` (v,) show an edge in depth: the halves of their templates move more
        differently than those of a plane, whose view has changed by ``change`` (v,) [rad], can."""
        s, std = self._settings, np.sqrt(self._strain[places, 2].max(axis=1, initial=0.0))
        own = (places >= 0) & (self.templates.id[places] > 0)
        return own & (std > s.most_strain + s.strain_of_tilt * change * self._camera.focal)

    def residuals(self, places: np.ndarray) -> np.ndarray:
        """(m, 2) the running mean residual of each of the features at ``places`` (m,) [px]; zero for the target."""
        return np.where((self.templates.id[places] > 0)[:, None], self._residual[places], 0.0)

    def proven(self, places: np.ndarray) -> np.ndarray:
        """(m,) which of the features at ``places`` (m,) were matched in as many images as it takes to judge a feature,
        since they last came into sight; the target is."""
        lately = self._seen[places] - self._since[places] >= self._settings.trials - 1
        return (self.templates.id[places] < 0) | (lately & (self._matched[places] >= self._enough))

    def failed(self) -> list[int]:
        """The features that were searched often and found seldom, or not where they should be."""
        s = self._settings
        seldom = (self._tried >= self._enough) & (self._matched < s.least_success * self._tried)
        residual, own = np.hypot(*self._residual.T), self.templates.id > 0
        searched = own & (self._tried > 0.0)
        typical = median(residual[searched].tolist()) if searched.any() else 0.0
        astray = residual > min(s.most_residual, max(s.odd_residual, _ODD * typical))
        return self.templates.id[(seldom | astray) & own].tolist()

    def longest_unseen(self, ids: np.ndarray, since: int) -> int | None:
        """The one of the features ``ids`` (n,) that was not seen for longest; None: all were after frame ``since``."""
        seen = self._seen[self.places(ids)]
        return int(ids[seen.argmin()]) if len(ids) and seen.min() < since else None
