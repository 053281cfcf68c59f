"""What a feature looks like: the patch of its first sight, and its appearance from elsewhere.

A patch lies on a small plane through the feature. A pixel z of the present image looks along d = R_WC r(z) and meets
that plane at X = p + d (n . (y - p)) / (n . d); the first camera saw X at the pixel where the stored patch is sampled.
This is the plane's homography, taken through the distortion of equation 1 on both sides.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import camera_from_world, pixel_from_camera_point, ray_from_pixel
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import QUATERNION

PATCH_HALF = 20
"""A stored patch has 2 x 20 + 1 pixels a side: room for a turn and for twice the distance."""
TEMPLATE_HALF = 7
"""A predicted template has 2 x 7 + 1 pixels a side."""
PATCH_SIDE, TEMPLATE_SIDE = 2 * PATCH_HALF + 1, 2 * TEMPLATE_HALF + 1

_LEAST_COSINE = 0.35
"""A plane seen more obliquely than this is not predicted."""
_SCALES = (0.45, 2.2)
"""Nor is one at less or more than so many times the distance of its first sight."""
_LEAST_INSIDE = 0.7
"""Nor is a template of which less than this share has been seen."""


class Templates(NamedTuple):
    """Patches of up to n features, by place; a place without a feature has id 0."""

    id: np.ndarray
    """(n,) the feature's serial number, or -1 - k for fiducial k."""
    patch: np.ndarray
    """(n, 41, 41) float32 grey values around the first sight; NaN outside the image."""
    pixel: np.ndarray
    """(n, 2) its pixel then: the centre of the patch [px]."""
    camera: np.ndarray
    """(n, 7) the camera's pose then: position [m] and quaternion q_WC."""
    normal: np.ndarray
    """(n, 3) the plane's normal in the world, away from the camera."""


def empty_templates(capacity: int) -> Templates:
    """No template, and room for ``capacity``."""
    return Templates(
        np.zeros(capacity, np.int64),
        np.zeros((capacity, PATCH_SIDE, PATCH_SIDE), np.float32),
        np.zeros((capacity, 2)),
        np.zeros((capacity, 7)),
        np.zeros((capacity, 3)),
    )


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
    camera: Record,
    templates: Templates,
    place: int,
    id: int,
    image: np.ndarray,
    pixel: np.ndarray,
    pose: np.ndarray,
    normal: np.ndarray,
) -> None:
    """Keep the patch of ``image`` around ``pixel`` (2,) as it is seen from ``pose`` (>= 7,).

    ``normal`` (3,) is the plane's normal in the world if it is known, or zero: then it faces the camera.
    """
    R_WC = rotation_matrix(pose[QUATERNION])
    ray = ray_from_pixel(camera, pixel)
    length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1.0)
    templates.id[place] = id
    known = normal[0] != 0.0 or normal[1] != 0.0 or normal[2] != 0.0
    for i in range(3):
        sight = (R_WC[i, 0] * ray[0] + R_WC[i, 1] * ray[1] + R_WC[i, 2]) / length
        templates.normal[place, i] = normal[i] if known else sight
    for i in range(7):
        templates.camera[place, i] = pose[i]
    for i in range(2):
        templates.pixel[place, i] = pixel[i]
    for i in range(PATCH_SIDE):
        for j in range(PATCH_SIDE):
            x, y = pixel[0] + (j - PATCH_HALF), pixel[1] + (i - PATCH_HALF)
            templates.patch[place, i, j] = sample(image, x, y)


def shows_template(picture: np.ndarray, pixel: np.ndarray) -> bool:
    """Whether ``picture`` (h, w) shows enough around ``pixel`` (2,) for a template, NaN being nothing."""
    x, y = (round(float(value)) for value in pixel)
    rows, columns = (slice(max(at - TEMPLATE_HALF, 0), max(at + TEMPLATE_HALF + 1, 0)) for at in (y, x))
    part = picture[rows, columns]
    return bool(np.isfinite(part).sum() >= _LEAST_INSIDE * TEMPLATE_SIDE**2)


@compiled
def predict_appearance(
    camera: Record,
    templates: Templates,
    place: int,
    pose: np.ndarray,
    R_WC: np.ndarray,
    point: np.ndarray,
    warp: bool,
    out: np.ndarray,
) -> bool:
    """Draw the template (15, 15) of the feature at ``point`` (3,) as seen from ``pose`` (>= 3,) into ``out``.

    The centre of ``out`` is the feature itself: on the sight line of the first camera, at the distance of ``point``.
    False where the view is too different from the first, or reaches beyond the patch.
    """
    nodes = np.empty((3, 3, 2))
    if not _view(camera, templates, place, pose, R_WC, point, nodes):
        return False
    if not warp:
        for i in range(3):
            for j in range(3):
                nodes[i, j, 0], nodes[i, j, 1] = (j - 1) * TEMPLATE_HALF, (i - 1) * TEMPLATE_HALF
    return _draw(templates.patch[place], nodes, out) >= _LEAST_INSIDE * TEMPLATE_SIDE * TEMPLATE_SIDE


@compiled
def _view(
    camera: Record,
    templates: Templates,
    place: int,
    pose: np.ndarray,
    R_WC: np.ndarray,
    point: np.ndarray,
    nodes: np.ndarray,
) -> bool:
    """Where the template's corners, edge middles and centre are in the patch: ``nodes`` (3, 3, 2) [px] from its centre.

    Between them the map is so nearly linear that interpolation is as good as the homography (under 0.02 px).
    """
    first, normal, born = templates.camera[place], templates.normal[place], templates.pixel[place]
    R_WB = rotation_matrix(first[QUATERNION])
    ray = ray_from_pixel(camera, born)
    far, length = 0.0, math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1.0)
    for i in range(3):
        far += (point[i] - first[i]) ** 2
    far = math.sqrt(far)
    sight, offset, d = np.empty(3), np.empty(3), np.empty(3)
    near, plane = 0.0, 0.0
    for i in range(3):
        offset[i] = pose[i] - first[i]
        sight[i] = far * (R_WB[i, 0] * ray[0] + R_WB[i, 1] * ray[1] + R_WB[i, 2]) / length - offset[i]
        near += sight[i] * sight[i]
        plane += normal[i] * sight[i]
    near = math.sqrt(near)
    if plane < _LEAST_COSINE * near or not _SCALES[0] * far < near < _SCALES[1] * far:
        return False
    centre, z = np.empty(2), np.empty(2)
    if not pixel_from_camera_point(camera, camera_from_world(R_WC, sight), centre):
        return False
    for i in range(3):
        for j in range(3):
            z[0], z[1] = centre[0] + (j - 1) * TEMPLATE_HALF, centre[1] + (i - 1) * TEMPLATE_HALF
            r = ray_from_pixel(camera, z)
            along = 0.0
            for k in range(3):
                d[k] = R_WC[k, 0] * r[0] + R_WC[k, 1] * r[1] + R_WC[k, 2]
                along += normal[k] * d[k]
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
            x = (
                w00 * nodes[m, n, 0]
                + w01 * nodes[m, n + 1, 0]
                + w10 * nodes[m + 1, n, 0]
                + w11 * nodes[m + 1, n + 1, 0]
            )
            y = (
                w00 * nodes[m, n, 1]
                + w01 * nodes[m, n + 1, 1]
                + w10 * nodes[m + 1, n, 1]
                + w11 * nodes[m + 1, n + 1, 1]
            )
            value = sample(patch, PATCH_HALF + x, PATCH_HALF + y)
            out[i, j] = value
            seen += not math.isnan(value)
    return seen
