"""The looks of a feature: the patch of its first sight, its appearance from elsewhere, and a running record of matches.

A patch lies on a small plane through the feature. A pixel z of the present image looks along d = R_WC r(z) and meets
that plane at X = p + d (n . (y - p)) / (n . d); the first camera saw X at the pixel where the stored patch is sampled.
This is the plane's homography, taken through the distortion of equation 1 on both sides.

The plane of a feature faces the first camera until other views tell its slopes; that of a fiducial is known.
"""

import math
from collections.abc import Iterable
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import (
    View,
    camera_from_world,
    distance_between,
    pixel_from_camera_point,
    ray_from_pixel,
    world_from_camera,
)
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.sight import IMAGE_PRODUCT_FRAMES, Sight
from activeslam_gym.vision.bundle import tangents
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.settings import ENOUGH, FrontEndSettings
from activeslam_gym.vision.views import changes_of_view, view_from

PATCH_HALF, TEMPLATE_HALF = 20, 7
PATCH_SIDE, TEMPLATE_SIDE = 2 * PATCH_HALF + 1, 2 * TEMPLATE_HALF + 1
"""Pixels a side of a stored patch, with room for a turn and for twice the distance, and of a predicted template."""
_NARROWEST = 0.35  # a plane that looks narrower than this share of its width at first sight is not predicted
_SCALES = (0.45, 2.2)  # nor is one at less or more than so many times the distance of its first sight
_SLOPE = 0.1  # by which a plane is tilted for a derivative
_SLOPE_STD = 0.7  # of the two slopes of a feature's plane, before they are fitted
_LEAST_SEEN = 0.5  # nor is a template of which less than this share has been seen
_LEAST_SHOWN = 0.7  # of a template that is drawn from a picture of the target


class Templates(NamedTuple):
    """Patches of up to n features, by place; a place without a feature has id 0."""

    id: np.ndarray  # (n,) of the feature, or -1 - k for fiducial k
    patch: np.ndarray  # (n, 41, 41) float32 grey values around the first sight; NaN outside the image
    pixel: np.ndarray  # (n, 2) its pixel then: the centre of the patch [px]
    camera: np.ndarray  # (n, 7) the camera's pose then: position [m] and quaternion q_WC
    normal: np.ndarray  # (n, 3) the plane's in the world, away from the camera; along the first sight it measures 1


def empty_templates(capacity: int) -> Templates:
    """No template, and room for ``capacity``."""
    patches = np.zeros((capacity, PATCH_SIDE, PATCH_SIDE), np.float32)
    return Templates(np.zeros(capacity, np.int64), patches, *(np.zeros((capacity, size)) for size in (2, 7, 3)))


@compiled
def sample(image: np.ndarray, x: float, y: float) -> float:
    """Bilinear grey value of ``image`` at (x, y) [px]; NaN outside it. Pixel (0, 0) is the centre of the first."""
    column, row = math.floor(x), math.floor(y)
    if column < 0 or row < 0 or column >= image.shape[1] - 1 or row >= image.shape[0] - 1:
        return np.nan
    a, b = x - column, y - row
    upper = (1.0 - a) * image[row, column] + a * image[row, column + 1]
    lower = (1.0 - a) * image[row + 1, column] + a * image[row + 1, column + 1]
    return (1.0 - b) * upper + b * lower


@compiled
def store(
    view: View, templates: Templates, place: int, id: int, image: np.ndarray, pixel: np.ndarray, normal: np.ndarray
) -> None:
    """Keep the patch of ``image`` around ``pixel`` (2,) as it is seen in ``view``, whose pose is (>= 7,).

    ``normal`` (3,) is the plane's normal in the world if it is known, or zero: then it faces the camera.
    """
    x, y, z = world_from_camera(view.R_WC, ray_from_pixel(view.lens, pixel))
    length = math.sqrt(x * x + y * y + z * z)
    sight = np.array((x / length, y / length, z / length))
    along = normal[0] * sight[0] + normal[1] * sight[1] + normal[2] * sight[2]
    copy_into(templates.normal[place], normal / along if along != 0.0 else sight)
    templates.id[place] = id
    copy_into(templates.camera[place], view.pose[:7])
    copy_into(templates.pixel[place], pixel)
    for i in range(PATCH_SIDE):
        for j in range(PATCH_SIDE):
            x, y = pixel[0] + (j - PATCH_HALF), pixel[1] + (i - PATCH_HALF)
            templates.patch[place, i, j] = sample(image, x, y)


def shows_template(picture: np.ndarray, pixel: np.ndarray) -> bool:
    """Whether ``picture`` (h, w) shows enough around ``pixel`` (2,) for a template, NaN being nothing."""
    x, y = (round(float(value)) for value in pixel)
    around = tuple(slice(max(at - TEMPLATE_HALF, 0), max(at + TEMPLATE_HALF + 1, 0)) for at in (y, x))
    return bool(np.isfinite(picture[around]).sum() >= _LEAST_SHOWN * TEMPLATE_SIDE**2)


@compiled
def predict_appearance(view: View, templates: Templates, place: int, point: np.ndarray, out: np.ndarray) -> bool:
    """Draw the template (15, 15) of the feature at ``point`` (3,) as it looks in ``view`` into ``out``.

    The centre of ``out`` is the feature itself: on the sight line of the first camera, at the distance of ``point``.
    False where the view is too different from the first, or reaches beyond the patch.
    """
    nodes = np.empty((3, 3, 2))
    if not _find_nodes(view, templates, place, point, nodes):
        return False
    return _draw(templates.patch[place], nodes, out) >= _LEAST_SEEN * TEMPLATE_SIDE * TEMPLATE_SIDE


@compiled
def _find_nodes(view: View, templates: Templates, place: int, point: np.ndarray, nodes: np.ndarray) -> bool:
    """Where the template's corners, edge middles and centre are in the patch: ``nodes`` (3, 3, 2) [px] from its centre.

    Between them the map is so nearly linear that interpolation is as good as the homography (under 0.02 px).
    """
    camera, first, normal, born = view.lens, templates.camera[place], templates.normal[place], templates.pixel[place]
    R_WB = rotation_matrix(first[QUATERNION])
    ray = ray_from_pixel(camera, born)
    length, along_ray = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1.0), world_from_camera(R_WB, ray)
    sight, offset = np.empty(3), np.empty(3)  # to the feature, and from the first camera to this one
    far, near, plane = distance_between(first, point), 0.0, 0.0
    for i in range(3):
        offset[i] = view.pose[i] - first[i]
        sight[i] = far * along_ray[i] / length - offset[i]
        near += sight[i] * sight[i]
        plane += normal[i] * sight[i]
    near = math.sqrt(near)
    if plane < _NARROWEST * near or not _SCALES[0] * far < near < _SCALES[1] * far:
        return False
    centre, z = np.empty(2), np.empty(2)
    if not pixel_from_camera_point(camera, camera_from_world(view.R_WC, sight), centre):
        return False
    for i in range(3):
        for j in range(3):
            z[0], z[1] = centre[0] + (j - 1) * TEMPLATE_HALF, centre[1] + (i - 1) * TEMPLATE_HALF
            d = world_from_camera(view.R_WC, ray_from_pixel(camera, z))
            along = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
            if along <= 0.0:
                return False
            t = plane / along
            p_W = (offset[0] + t * d[0], offset[1] + t * d[1], offset[2] + t * d[2])
            if not pixel_from_camera_point(camera, camera_from_world(R_WB, p_W), z):
                return False
            nodes[i, j, 0], nodes[i, j, 1] = z[0] - born[0], z[1] - born[1]
    return True


@compiled
def _draw(patch: np.ndarray, nodes: np.ndarray, out: np.ndarray) -> int:
    """Sample ``patch`` at the places that ``nodes`` (3, 3, 2) spread over ``out`` (15, 15); how many it has."""
    seen = 0
    for i in range(TEMPLATE_SIDE):
        m = i // (TEMPLATE_HALF + 1)
        b = (i - m * TEMPLATE_HALF) / TEMPLATE_HALF
        for j in range(TEMPLATE_SIDE):
            n = j // (TEMPLATE_HALF + 1)
            a = (j - n * TEMPLATE_HALF) / TEMPLATE_HALF
            w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
            upper, lower = nodes[m], nodes[m + 1]
            x = w00 * upper[n, 0] + w01 * upper[n + 1, 0] + w10 * lower[n, 0] + w11 * lower[n + 1, 0]
            y = w00 * upper[n, 1] + w01 * upper[n + 1, 1] + w10 * lower[n, 1] + w11 * lower[n + 1, 1]
            value = sample(patch, PATCH_HALF + x, PATCH_HALF + y)
            out[i, j] = value
            seen += not math.isnan(value)
    return seen


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
        self.residual, self.alike = np.zeros((rows, 2)), np.zeros(rows)
        """Of the feature at each place its running mean residual (rows, 2) [px], and how often it was matched in nearly
        the present view (rows,); zero for the target, whose biases are states."""
        self.strayed = 0.0
        """Sum of the residuals of the features that failed last, were found often and matched in three images [px]."""
        self._tried, self._matched = np.zeros(rows), np.zeros(rows)
        self._keep, self._enough = 1.0 - 1.0 / settings.trials, ENOUGH * settings.trials
        self._seen, self._since = np.zeros(rows, np.int64), np.zeros(rows, np.int64)  # last image, and first of a run
        self._fitted_from, self._slope_covariance = np.zeros((rows, 3)), np.zeros((rows, 2, 2))  # of the plane

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
            for record in (self._tried, self._matched, self.residual):
                record[place] = 0.0
            self._seen[place] = self._since[place] = frame
        self._fitted_from[self._place[id]], self.alike[self._place[id]] = camera[:3], 0.0
        self._slope_covariance[self._place[id]] = _SLOPE_STD**2 * np.eye(2)
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

    def fit_planes(
        self, view: View, grey: np.ndarray, places: np.ndarray, points: np.ndarray, pixels: np.ndarray
    ) -> None:
        """Refine the slopes of the planes of features whose view is new (after Molton, Davison and Reid 2004).

        The features at ``places`` (m,) with world points ``points`` (m, 3) were matched at ``pixels`` (m, 2) of
        ``grey`` (h, w) float32. Many images of one view tell no more than one: the template has the same error.
        """
        change = changes_of_view(self._fitted_from[places], view.pose, points)
        is_new, own = change > self._settings.fitted_every, self.templates.id[places] > 0
        self.alike[places] = np.where(own & ~is_new, self.alike[places] + 1.0, 0.0)
        for k in np.flatnonzero(own & is_new):
            self._fit_plane(view, grey, int(places[k]), points[k], pixels[k])

    def _fit_plane(self, view: View, grey: np.ndarray, place: int, point: np.ndarray, pixel: np.ndarray) -> None:
        """One step of Gauss and Newton from the prior of the slopes.

        The image at ``pixel`` + x is gain T(x + d; slopes) + brightness.
        """
        normal, covariance = self.templates.normal[place], self._slope_covariance[place]
        sight = point - self.templates.camera[place, :3]
        across = tangents(sight / np.linalg.norm(sight)).T
        drawn = np.empty((3, TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
        facing, seen = normal.copy(), True
        for T, slope in zip(drawn, (0.0 * across[0], *_SLOPE * across)):
            normal[:] = facing + slope
            seen &= predict_appearance(view, self.templates, place, point, T)
        normal[:] = facing
        if not seen:
            return
        T, by_slopes = drawn[0, 1:-1, 1:-1], (drawn[1:] - drawn[0])[:, 1:-1, 1:-1] / _SLOPE
        by_pixel = 0.5 * (drawn[0, 1:-1, 2:] - drawn[0, 1:-1, :-2]), 0.5 * (drawn[0, 2:, 1:-1] - drawn[0, :-2, 1:-1])
        image = opencv().getRectSubPix(grey, T.shape, pixel)
        rows = np.array((np.ones_like(T), T, *by_pixel, *by_slopes, image), float).reshape(7, -1)
        rows = rows[:, np.isfinite(rows).all(axis=0)]
        A, b, prior = rows[:-1], rows[-1], np.diag((0.0, 0.0, 1.0, 1.0, 0.0, 0.0))  # it was found to a pixel
        prior[4:, 4:] = np.linalg.inv(covariance)
        N, g = A @ A.T, A @ b
        squares = b @ b - g[:4] @ np.linalg.lstsq(N[:4, :4], g[:4], rcond=None)[0]
        var = self._settings.grain * max(squares / max(len(b), 1), 1e-3)
        P = np.linalg.inv(N / var + prior)
        x = P @ g / var
        normal += x[4:] / x[1] @ across
        covariance[:], self._fitted_from[place] = P[4:, 4:], view.pose[:3]

    def judge(self, ids: Iterable[int], matched: np.ndarray, inside: np.ndarray, frame: int) -> None:
        """Remember which of the searched ``ids`` (m,) were ``matched`` (m,); a miss counts if well ``inside`` (m,)."""
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
        row, k = np.nonzero((found["match"][:, None] == sight.point["id"]) & (sight.point["id"] > 0))
        found, point = found[row], sight.point[k]
        keep, frames = self._keep, IMAGE_PRODUCT_FRAMES if self._camera.command_known else 0.0
        noise, neglected = np.trace(found["R"], 0, 1, 2), frames * np.trace(point["curvature"], 0, 1, 2)
        weight = (1.0 - keep) * (noise / np.maximum(noise + neglected, 1e-12))[:, None]
        places = self.places(found["match"])
        self.residual[places] = keep * self.residual[places] + weight * (found["pixel"] - point["z_hat"])

    def proven(self, places: np.ndarray) -> np.ndarray:
        """(m,) which of the features at ``places`` (m,) were matched in as many images as it takes to judge a feature,
        since they last came into sight; the target is."""
        lately = self._seen[places] - self._since[places] >= self._settings.trials - 1
        return (self.templates.id[places] < 0) | (lately & (self._matched[places] >= self._enough))

    def failed(self) -> list[int]:
        """The features that were searched often and found seldom, or not where they should be."""
        s = self._settings
        seldom = (self._tried >= self._enough) & (2.0 * self._matched < self._tried)
        residual, own = np.hypot(*self.residual.T), self.templates.id > 0
        searched = own & (self._tried > 0.0)
        typical = median(residual[searched].tolist()) if searched.any() else 0.0
        astray = residual > max(s.most_residual, _ODD * typical)
        self.strayed = float(residual[astray & own & ~seldom & (self._matched > 2.0)].sum())
        return self.templates.id[(seldom | astray) & own].tolist()

    def longest_unseen(self, ids: np.ndarray, since: int) -> int | None:
        """The one of the features ``ids`` (n,) that was not seen for longest; None: all were after frame ``since``."""
        seen = self._seen[self.places(ids)]
        return int(ids[seen.argmin()]) if len(ids) and seen.min() < since else None
