"""The front end's memory of each feature: a template with the view of its first sight, and a running record."""

from collections.abc import Iterable
from statistics import median
from typing import Any

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.slam.curvature import IMAGE_PRODUCT_FRAMES
from activeslam_gym.slam.sight import Sight
from activeslam_gym.vision.settings import ENOUGH, FrontEndSettings
from activeslam_gym.vision.templates import empty_templates, store
from activeslam_gym.vision.views import changes_of_view, view_from

_ODD = 4.0  # times the median residual of all features, from which one alone is astray


class TemplateMap:
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
        self._keep, self._enough = 1.0 - 1.0 / settings.trials, ENOUGH * settings.trials
        self._seen, self._since = np.zeros(rows, np.int64), np.zeros(rows, np.int64)  # last image, and first of a run

    @property
    def features(self) -> int:
        """How many, fiducials left out."""
        return int(np.count_nonzero(self.templates.id > 0))

    def add(
        self, id: int, grey: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray, frame: int
    ) -> None:
        """Keep the looks of a feature or fiducial first seen at ``pixel`` (2,) of ``grey`` (h, w) float32 from
        ``camera`` (>= 7,); ``normal`` (3,): its plane's in the world, away from the camera, or zeros if unknown. One
        that hangs already gets new looks, and keeps its record."""
        if id not in self._place:
            self._place[id] = place = int(np.flatnonzero(self.templates.id == 0)[0])
            for record in (self._tried, self._matched, self._residual):
                record[place] = 0.0
            self._seen[place] = self._since[place] = frame
        view = view_from(self._camera, camera)
        store(view, self.templates, self._place[id], id, grey, np.asarray(pixel, float), normal)

    def remove(self, id: int) -> None:
        """Delete a feature."""
        self.templates.id[self._place.pop(id)] = 0

    def places(self, ids: Any) -> np.ndarray:
        """(v,) the rows of the templates of ``ids`` (v,); -1: it has none."""
        return np.array([self._place.get(id, -1) for id in np.asarray(ids).tolist()], np.int64)

    def ids(self) -> np.ndarray:
        """(n,) of all."""
        return np.array(list(self._place), np.int64)

    def change_of_view(self, places: np.ndarray, points: np.ndarray, now: np.ndarray) -> np.ndarray:
        """(v,) the change of view of the features at ``places`` (v,), now at ``points`` (v, 3), from their first sight
        to ``now`` (3,); zero for the target, whose plane is known."""
        change = changes_of_view(self.templates.camera[places], now, points)
        return np.where((places < 0) | (self.templates.id[places] < 0), 0.0, change)

    def judge(self, ids: Iterable[int], matched: np.ndarray, inside: np.ndarray, frame: int) -> None:
        """Remember of the searched ``ids`` (m,) which were ``matched`` (m,); a miss counts where the feature is well
        ``inside`` (m,) the image."""
        places, keep = self.places(ids), self._keep
        again = places[matched & (frame - self._seen[places] > self._settings.trials)]
        self._since[again] = frame
        self._seen[places[matched]] = frame
        judged = matched | inside
        self._tried[places[judged]] = keep * self._tried[places[judged]] + 1.0
        self._matched[places[judged]] = keep * self._matched[places[judged]] + matched[judged]

    def remember_residuals(self, found: np.ndarray, sight: Sight) -> None:
        """The running mean, of each feature, of its matched pixel in ``found`` (M,) DETECTION less its pixel in the
        ``sight`` of the updated estimate; of that the share which is noise, and not error of the linearisation, where
        the filter counts that several times: else it would count twice."""
        row, k = np.nonzero(found["match"][:, None] == sight.point["id"])
        found, point = found[row], sight.point[k]
        keep, frames = self._keep, IMAGE_PRODUCT_FRAMES if self._camera.command_known else 0.0
        noise, neglected = np.trace(found["R"], 0, 1, 2), frames * np.trace(point["curvature"], 0, 1, 2)
        weight = (1.0 - keep) * (noise / np.maximum(noise + neglected, 1e-12))[:, None]
        places = self.places(found["match"])
        self._residual[places] = keep * self._residual[places] + weight * (found["pixel"] - point["z_hat"])

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
        seldom = (self._tried >= self._enough) & (2.0 * self._matched < self._tried)
        residual, own = np.hypot(*self._residual.T), self.templates.id > 0
        searched = own & (self._tried > 0.0)
        typical = median(residual[searched].tolist()) if searched.any() else 0.0
        astray = residual > max(s.most_residual, _ODD * typical)
        return self.templates.id[(seldom | astray) & own].tolist()

    def longest_unseen(self, ids: np.ndarray, since: int) -> int | None:
        """The one of the features ``ids`` (n,) that was not seen for longest; None: all were after frame ``since``."""
        seen = self._seen[self.places(ids)]
        return int(ids[seen.argmin()]) if len(ids) and seen.min() < since else None
