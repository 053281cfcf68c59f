"""What the front end remembers of each feature: how it looks, from where it was first seen, and how it fared since."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.slam.sight import Sight
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import empty_templates, store
from activeslam_gym.vision.views import change_of_view


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
        self._tried, self._matched = np.zeros(rows), np.zeros(rows)
        self._residual = np.zeros((rows, 2))
        self._seen = np.zeros(rows, np.int64)

    def __contains__(self, id: int) -> bool:
        return id in self._place

    @property
    def features(self) -> int:
        """How many, fiducials left out."""
        return int(np.count_nonzero(self.templates.id > 0))

    def hang(
        self, id: int, grey: np.ndarray, pixel: np.ndarray, camera: np.ndarray, normal: np.ndarray, frame: int
    ) -> None:
        """Keep the looks of a feature or fiducial first seen at ``pixel`` (2,) of ``grey`` (h, w) float32 from
        ``camera`` (>= 7,); ``normal`` (3,): its plane's in the world, away from the camera, or zeros if unknown. What
        hangs already gets new looks, and keeps its record."""
        if id not in self._place:
            place = int(np.flatnonzero(self.templates.id == 0)[0])
            self._place[id] = place
            self._tried[place], self._matched[place], self._seen[place] = 0.0, 0.0, frame
            self._residual[place] = 0.0
        place = self._place[id]
        store(self._camera, self.templates, place, id, grey, np.asarray(pixel, float), camera, normal)

    def remove(self, id: int) -> None:
        """Forget a feature."""
        self.templates.id[self._place.pop(id)] = 0

    def places(self, ids: Collection[int] | np.ndarray) -> np.ndarray:
        """(v,) the rows of the templates of ``ids`` (v,); -1: it has none."""
        return np.array([self._place.get(int(id), -1) for id in ids], np.int64)

    def best(self, count: int, of: Collection[int] | None = None) -> list[int]:
        """Those ``count`` of the ids ``of`` (None: of all) that were matched most of late."""
        return sorted(self._place if of is None else of, key=lambda id: -self._matched[self._place[id]])[:count]

    def change_of_view(self, places: np.ndarray, points: np.ndarray, now: np.ndarray) -> np.ndarray:
        """(v,) how differently the features at ``places`` (v,), now at ``points`` (v, 3), are seen from ``now`` (3,)
        and from where they were first; the target, whose plane is known, never is."""
        change = change_of_view(self.templates.camera[places, :3], now, points)
        return np.where((places < 0) | (self.templates.id[places] < 0), 0.0, change)

    # How they fared ---------------------------------------------------------------------------------------------------

    def judge(self, searched: Collection[int], matched: set[int], telling: set[int], frame: int) -> None:
        """Remember which of the ``searched`` were ``matched``; a miss counts where it is ``telling``."""
        keep = self._settings.memory
        for id in searched:
            place, hit = self._place[id], id in matched
            if hit:
                self._seen[place] = frame
            if hit or id in telling:
                self._tried[place] = keep * self._tried[place] + 1.0
                self._matched[place] = keep * self._matched[place] + hit

    def remember_residuals(self, found: np.ndarray, sight: Sight) -> None:
        """How far the matched pixels of ``found`` (M,) DETECTION are from where the updated belief, which ``sight`` is
        of, has them: each feature's running mean."""
        at = {int(id): z for id, z in zip(sight.thing["id"], sight.thing["z_hat"])}
        keep = self._settings.memory
        for id, pixel in zip(found["match"].tolist(), found["pixel"]):
            if id in at:
                self._residual[self._place[id]] *= keep
                self._residual[self._place[id]] += (1.0 - keep) * (pixel - at[id])

    def failed(self) -> list[int]:
        """The features that were searched often and found seldom, or not where they should be."""
        s = self._settings
        enough = (1.0 - s.memory**s.trials) / (1.0 - s.memory)
        seldom = (self._tried >= enough) & (self._matched < s.least_success * self._tried)
        astray = np.hypot(*self._residual.T) > s.most_residual
        return self.templates.id[(seldom | astray) & (self.templates.id > 0)].tolist()

    def longest_unseen(self, since: int) -> int | None:
        """The feature that was not seen for longest; None if all were after the frame ``since``, or there is none."""
        known = np.flatnonzero(self.templates.id > 0)
        if not len(known):
            return None
        oldest = known[self._seen[known].argmin()]
        return int(self.templates.id[oldest]) if self._seen[oldest] < since else None
