"""A photograph of the room: image = f(scene, pose and velocity, lens, sensor, frame, key), and nothing else.

So it does not depend on what was seen before, on the policy, on the thread, or on being one of a batch. From light to
grey values there are the lens's softness, blur of motion, drift of the gain, and noise. The picture is exposed about
the instant of its pose: half before and half after it, so that blur does not shift it.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import camera_from_world, pixel_jacobian, ray_from_pixel, ray_jacobian
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import QUATERNION
from activeslam_gym.vision.room.geometry import SIGHT, Scene, candidates, inverse_depth_at, look
from activeslam_gym.vision.room.shading import COLOUR, REST, TILE, TILE_HEIGHT, TILE_WIDTH, VECTORS, add_rectangle
from activeslam_gym.world.noise import normals, uniforms

PAD = 20  # pixels by which pictures are continued on each side while they are worked on
_LONGEST = 30.0  # blur is no longer than that [px]
_NOISE_TILE = 1 << 16  # normal numbers, drawn once; each row of an image takes its own, from a random place on
_WIDEST = 4096  # greatest width of an image
_NOISE = np.random.default_rng(0).standard_normal(_NOISE_TILE + _WIDEST).astype(np.float32)  # of every camera
_DRAWS = 4096  # draws that an image may use: one for each row
_GAIN_STREAM = 1 << 50  # draws from here on are of the gain, which is far beyond those of any frame


class Sensor(NamedTuple):
    """The way from light to grey values; as it is, of a webcam in a lit room.

    The lens blurs by the weights (side, 1 - 2 side, side) across and down, of variance 2 side [px^2].
    """

    exposure: float = 0.02  # time during which an image is exposed [s]; zero: no blur
    noise_std: float = 2.0  # of a pixel [grey levels]
    gain_std: float = 0.03  # of the gain's drift about one
    gain_period: int = 60  # frames between two independent gains; smooth between them
    side: float = 0.125  # weight of each neighbour in the lens's blur
    noise: np.ndarray = _NOISE


class Lens(NamedTuple):
    """A camera's rays, worked out once for every pixel, so that its distortion costs nothing a frame, and kept tile by
    tile. Pixel (0, 0) is the centre of the top left pixel."""

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


@compiled
def extend(picture: np.ndarray) -> None:
    """Continue a picture into its margin of ``PAD`` by its outermost pixels."""
    height, width = picture.shape
    for v in range(PAD, height - PAD):
        picture[v, :PAD], picture[v, width - PAD :] = picture[v, PAD], picture[v, width - 1 - PAD]
    for v in range(PAD):
        picture[v], picture[height - 1 - v] = picture[PAD], picture[height - 1 - PAD]


@compiled
def softened(sharp: np.ndarray, side: float) -> np.ndarray:
    """The picture with the lens's point spread, see `Sensor`; its outermost pixels are not."""
    a, c = np.float32(side), np.float32(1.0 - 2.0 * side)
    middle, edge, corner = c * c, a * c, a * a
    soft = np.empty_like(sharp)
    for v in range(1, sharp.shape[0] - 1):
        for u in range(1, sharp.shape[1] - 1):
            beside = sharp[v, u - 1] + sharp[v, u + 1] + sharp[v - 1, u] + sharp[v + 1, u]
            across = sharp[v - 1, u - 1] + sharp[v - 1, u + 1] + sharp[v + 1, u - 1] + sharp[v + 1, u + 1]
            soft[v, u] = middle * sharp[v, u] + edge * beside + corner * across
    return soft


@compiled
def smear(soft: np.ndarray, flows: np.ndarray, columns: int, out: np.ndarray) -> None:
    """Blur each tile along its own flow (tiles, 2) [px] during the exposure.

    The line is sampled at whole pixels along its longer side, and between two pixels along the other.
    """
    for tile in range(flows.shape[0]):
        v, u = PAD + TILE_HEIGHT * (tile // columns), PAD + TILE_WIDTH * (tile % columns)
        out[v : v + TILE_HEIGHT, u : u + TILE_WIDTH] = np.float32(0.0)
        flow_u, flow_v = flows[tile, 0], flows[tile, 1]
        upright = abs(flow_v) > abs(flow_u)
        longer, other = (flow_v, flow_u) if upright else (flow_u, flow_v)
        length = min(max(abs(longer), 1e-3), _LONGEST)
        slope = other / longer if longer != 0.0 else 0.0
        reach = int(0.5 * length + 0.5)
        for step in range(-reach, reach + 1):
            share = (min(step + 0.5, 0.5 * length) - max(step - 0.5, -0.5 * length)) / length
            aside = math.floor(slope * step)
            between = slope * step - aside
            for near in range(2):
                weight = np.float32(share * (between if near == 1 else 1.0 - between))
                across, down = (aside + near, step) if upright else (step, aside + near)
                _add_shifted(soft, v, u, int(down), int(across), weight, out)


@compiled
def _add_shifted(soft: np.ndarray, v: int, u: int, down: int, across: int, weight: np.float32, out: np.ndarray) -> None:
    """Add to the tile at row ``v``, column ``u`` the one that lies ``down`` and ``across`` from it, by its weight."""
    for i in range(TILE_HEIGHT):
        target = out[v + i, u : u + TILE_WIDTH]
        source = soft[v + i + down, u + across : u + across + TILE_WIDTH]
        for j in range(TILE_WIDTH):
            target[j] += weight * source[j]


@compiled
def gain(sensor: Sensor, frame: int, key: np.ndarray) -> float:
    """The gain of a frame: normal numbers ``gain_period`` frames apart, smoothly interpolated (variance preserved)."""
    knot = frame // sensor.gain_period
    t = (frame - knot * sensor.gain_period) / sensor.gain_period
    draws = normals(key, _GAIN_STREAM + 2 * knot, 4)
    weight = t * t * (3.0 - 2.0 * t)
    drift = (1.0 - weight) * draws[0] + weight * draws[2]
    return 1.0 + sensor.gain_std * drift / math.sqrt(weight * weight + (1.0 - weight) ** 2)


@compiled
def developed(picture: np.ndarray, sensor: Sensor, frame: int, key: np.ndarray, shape: tuple) -> np.ndarray:
    """Grey values uint8 of that ``shape`` (H, W) by the light in ``picture``: gain, noise, white at most, rounding."""
    image, rows = np.empty(shape, np.uint8), uniforms(key, _DRAWS * frame, shape[0])
    factor, std = np.float32(gain(sensor, frame, key)), np.float32(sensor.noise_std)
    black, white, half = np.float32(0.0), np.float32(255.0), np.float32(0.5)
    for v in range(image.shape[0]):
        start = int(_NOISE_TILE * rows[v])
        source, noise, target = picture[v + PAD], sensor.noise[start : start + image.shape[1]], image[v]
        for u in range(image.shape[1]):
            value = factor * source[u + PAD] + std * noise[u]
            target[u] = np.uint8(np.int32(min(max(value, black), white) + half))
    return image


_STILL = 1.0  # where nothing flows farther than that during the exposure [px], there is no blur


@compiled
def render(
    scene: Scene, lens: Lens, sensor: Sensor, state: np.ndarray, frame: int, key: np.ndarray, windows: np.ndarray
) -> np.ndarray:
    """A photograph of the scene (H, W) uint8; only its ``windows`` (n, 4) are sure to be worked out, see `Photograph`.

    ``state`` (13,) is the camera's in the middle of the exposure: position, quaternion, velocity, angular velocity
    (world frame). ``key`` (1,) uint64 is the stream of the noise, of which frame k uses its own part.
    """
    sights = np.zeros(scene.surfaces.shape[0], SIGHT)
    sights = sights[: look(scene, state, lens.image_bounds, sights)]
    flows = _flows_of(lens, sensor.exposure, state, sights)
    longest = np.abs(flows).max()
    reach = 1 + (int(0.5 * min(longest, _LONGEST)) + 2 if longest > _STILL else 0)  # of the lens's blur and of motion's
    picture = _exposed(scene, lens, sights, _tiles_of(lens, windows, reach))
    extend(picture)
    soft = softened(picture, sensor.side)
    if longest > _STILL:
        smear(soft, flows, lens.columns, picture)
    else:
        picture = soft
    return developed(picture, sensor, frame, key, (int(lens.camera.height), int(lens.camera.width)))


@compiled
def _tiles_of(lens: Lens, windows: np.ndarray, reach: int) -> np.ndarray:
    """(tiles,) those that meet one of the ``windows`` (n, 4), or are nearer to it than ``reach`` [px]."""
    rows = lens.rays.shape[0] // lens.columns
    out = np.zeros((rows, lens.columns), np.bool_)
    for k in range(windows.shape[0]):
        left, right = max(windows[k, 0] - reach, 0) // TILE_WIDTH, (windows[k, 1] + reach) // TILE_WIDTH
        top, bottom = max(windows[k, 2] - reach, 0) // TILE_HEIGHT, (windows[k, 3] + reach) // TILE_HEIGHT
        for i in range(top, min(bottom + 1, rows)):
            for j in range(left, min(right + 1, lens.columns)):
                out[i, j] = True
    return out.reshape(-1)


@compiled
def _exposed(scene: Scene, lens: Lens, sights: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """The light in each pixel of the tiles that are ``shown`` (tiles,), and PAD around, float32 [grey levels]."""
    tiles, near = lens.rays.shape[0], np.zeros(sights.shape[0], np.int64)
    rows, columns = tiles // lens.columns * TILE_HEIGHT, lens.columns * TILE_WIDTH
    picture = np.zeros((rows + 2 * PAD, columns + 2 * PAD), np.float32)
    floats, places = np.zeros(VECTORS * TILE, np.float32), np.zeros(TILE, np.uint32)
    one, tiny = np.float32(1.0), np.float32(1e-6)
    for tile in range(tiles):
        if not shown[tile]:
            continue
        rays = lens.rays[tile].reshape(-1)
        found, covered = candidates(sights, sights.shape[0], lens.bounds[tile], near)
        floats[REST : REST + TILE], floats[COLOUR : COLOUR + TILE] = one, np.float32(0.0)
        for k in range(found):
            sight = sights[near[k]]
            texture = scene.textures[sight.texture].reshape(-1)
            add_rectangle(sight, covered and k == found - 1, rays, texture, floats, places)
        v, u = PAD + TILE_HEIGHT * (tile // lens.columns), PAD + TILE_WIDTH * (tile % lens.columns)
        for at in range(TILE):  # where shares do not add up to one quite, they are made to
            light = floats[COLOUR + at] / max(one - floats[REST + at], tiny)
            picture[v + at // TILE_WIDTH, u + at % TILE_WIDTH] = light
    return picture


@compiled
def _flows_of(lens: Lens, exposure: float, state: np.ndarray, sights: np.ndarray) -> np.ndarray:
    """(tiles, 2) how far [px] the middle of each tile moves during the exposure, by its inverse depth.

    A point at p_C moves by dp_C/dt = -R^T (v + w x R p_C) in the camera.
    """
    R_WC = rotation_matrix(state[QUATERNION])
    v_C = camera_from_world(R_WC, (state[7], state[8], state[9]))
    w_C = camera_from_world(R_WC, (state[10], state[11], state[12]))
    J, flows = np.zeros((2, 3)), np.empty((lens.rays.shape[0], 2))
    for tile in range(flows.shape[0]):
        bounds, inverse_depth = lens.bounds[tile], 0.0
        x, y = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3])
        for k in range(sights.shape[0]):
            inverse_depth = inverse_depth_at(sights[k], x, y)
            if inverse_depth != 0.0:
                break
        pixel_jacobian(lens.camera, (x, y, 1.0), J)  # at depth one, where the velocity is divided by the depth
        moved = (
            -inverse_depth * v_C[0] - (w_C[1] - w_C[2] * y),
            -inverse_depth * v_C[1] - (w_C[2] * x - w_C[0]),
            -inverse_depth * v_C[2] - (w_C[0] * y - w_C[1] * x),
        )
        for i in range(2):
            flows[tile, i] = exposure * (J[i, 0] * moved[0] + J[i, 1] * moved[1] + J[i, 2] * moved[2])
    return flows
