"""The lens as a table: the ray of every pixel, worked out once, so that its distortion costs nothing a frame.

The image is cut into tiles of 16 by 8 pixels, and the table is kept tile by tile: the ray-caster treats a tile as a
vector of 128. Pixel (0, 0) is the centre of the top left pixel.
"""

from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import ray_from_pixel, ray_jacobian
from activeslam_gym.kernels import Record, compiled

TILE_WIDTH, TILE_HEIGHT = 16, 8
TILE = TILE_WIDTH * TILE_HEIGHT


class Lens(NamedTuple):
    """A camera's rays."""

    camera: Record
    columns: int  # tiles side by side; the last may reach over the image's edge
    rays: np.ndarray  # (tiles, 5, TILE) float32: x and y of each ray (x, y, 1); dx/du, dx/dv = dy/du, dy/dv [1/px]
    bounds: np.ndarray  # (tiles, 4): least x, greatest x, least y, greatest y of a tile and a pixel around it
    image_bounds: np.ndarray  # (4,) the same for the whole image


def lens_of(camera: Record, rays: np.ndarray | None = None) -> Lens:
    """The table of a camera, whose width and height are whole numbers; of a lens of another model, the ``rays``
    (H, W, 2) of its pixels: x to the left and y up at depth 1."""
    columns, rows = -(-int(camera.width) // TILE_WIDTH), -(-int(camera.height) // TILE_HEIGHT)
    table = np.empty((5, rows * TILE_HEIGHT, columns * TILE_WIDTH))
    _trace(camera, table)
    if rays is not None:
        h, w = rays.shape[:2]
        (dv_x, du_x), (dv_y, du_y) = (np.gradient(rays[..., axis]) for axis in (0, 1))
        table[:, :h, :w] = rays[..., 0], rays[..., 1], du_x, 0.5 * (dv_x + du_y), dv_y
    by_tile = table.reshape(5, rows, TILE_HEIGHT, columns, TILE_WIDTH).transpose(1, 3, 0, 2, 4)
    rays = by_tile.reshape(rows * columns, 5, TILE)
    reach = np.abs(rays[:, 2:]).sum(1)  # of a pixel
    low, high = ((rays[:, :2] + sign * reach[:, None]) for sign in (-1, 1))
    bounds = np.stack([low.min(2), high.max(2)], axis=2).reshape(-1, 4)
    image_bounds = np.array([bounds[:, 0].min(), bounds[:, 1].max(), bounds[:, 2].min(), bounds[:, 3].max()])
    return Lens(camera, columns, np.ascontiguousarray(rays, np.float32), bounds, image_bounds)


@compiled
def _trace(camera: Record, table: np.ndarray) -> None:
    """Fill the ``table`` (5, H, W), as `Lens.rays` has it, row by row."""
    pixel = np.empty(2)
    for v in range(table.shape[1]):
        for u in range(table.shape[2]):
            pixel[0], pixel[1] = u, v
            ray, slope = ray_from_pixel(camera, pixel), ray_jacobian(camera, pixel)
            table[0, v, u], table[1, v, u] = ray[0], ray[1]
            table[2, v, u], table[3, v, u], table[4, v, u] = slope[0, 0], slope[0, 1], slope[1, 1]
