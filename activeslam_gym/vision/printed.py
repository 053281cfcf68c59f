"""How a printed target should look: drawn for a camera's pose, as soft as its images and no farther than the sheet."""

import numpy as np
from scipy.ndimage import gaussian_filter

from activeslam_gym.kernels import Record
from activeslam_gym.vision.target import Rectangle
from activeslam_gym.vision.views import bounding_box, plane_points, projected

_BLACK, _WHITE = 25.0, 225.0
"""Grey levels of a printed target."""
_LEAST_SLANT = 0.3
"""Sine of the angle between the sight line and the target's plane under which it is not drawn."""
_RIM = 1.5
"""Pixels at the edge of its sheet in which there is something of what is behind it."""
_AROUND = 22.0
"""Pixels around a corner that its templates may need: half a patch, and what blurs into it."""


def printed_target(
    camera: Record, target: Rectangle, sheet: tuple[float, float], pose: np.ndarray, softness: float
) -> tuple[np.ndarray, np.ndarray]:
    """The target as it is printed on a ``sheet`` (width, height [m]), seen from ``pose`` (>= 7,) in its frame: the
    picture (h, w) float32 around its corners, NaN elsewhere and beside the sheet, and the corners (4, 2) [px].

    ``softness``: deviation of the camera's blur [px]. A template that is sharper than the image is found inside of
    the corner, and so is one that shows white where the sheet has ended.

    Raises:
        ValueError: a corner is behind the camera, or the target is seen from its edge or from behind.
    """
    if pose[2] < _LEAST_SLANT * np.linalg.norm(pose[:3]):
        raise ValueError("the target is not seen from before it")
    corners = projected(camera, pose, target.fiducials)
    out = np.full((int(camera.height), int(camera.width)), np.nan, np.float32)
    low, high = bounding_box(corners, _AROUND, out.shape)
    if (high - low < 2).any():
        return out, corners
    X = plane_points(camera, pose, np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    share, on = 1.0, True
    for axis, half in enumerate((0.5 * target.width, 0.5 * target.height)):
        from_middle = np.abs(X[..., axis])
        per_pixel = np.hypot(*np.gradient(X[..., axis]))
        share = share * np.clip((half - from_middle) / per_pixel + 0.5, 0.0, 1.0)
        on = on & (from_middle < 0.5 * sheet[axis] - _RIM * per_pixel)
    seen = gaussian_filter(_WHITE + (_BLACK - _WHITE) * share, softness)
    out[low[1] : high[1], low[0] : high[0]] = np.where(on, seen, np.nan)
    return out, corners
