"""From light to grey values: the lens's softness, blur of motion, drift of the gain, noise.

The picture is exposed about the instant of its pose: half before and half after it, so that blur does not shift it.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import compiled
from activeslam_gym.vision.room.lens import TILE_HEIGHT, TILE_WIDTH
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


@compiled
def extend(picture: np.ndarray) -> None:
    """Continue a picture into its margin of ``PAD`` by its outermost pixels."""
    height, width = picture.shape
    for v in range(PAD, height - PAD):
        picture[v, :PAD], picture[v, width - PAD :] = picture[v, PAD], picture[v, width - 1 - PAD]
    for v in range(PAD):
        picture[v], picture[height - 1 - v] = picture[PAD], picture[height - 1 - PAD]


@compiled
def soften(sharp: np.ndarray, side: float, soft: np.ndarray) -> None:
    """The lens's point spread, see `Sensor`."""
    a, c = np.float32(side), np.float32(1.0 - 2.0 * side)
    middle, edge, corner = c * c, a * c, a * a
    for v in range(1, sharp.shape[0] - 1):
        for u in range(1, sharp.shape[1] - 1):
            beside = sharp[v, u - 1] + sharp[v, u + 1] + sharp[v - 1, u] + sharp[v + 1, u]
            across = sharp[v - 1, u - 1] + sharp[v - 1, u + 1] + sharp[v + 1, u - 1] + sharp[v + 1, u + 1]
            soft[v, u] = middle * sharp[v, u] + edge * beside + corner * across


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
def develop(picture: np.ndarray, sensor: Sensor, frame: int, key: np.ndarray, image: np.ndarray) -> None:
    """Grey values ``image`` (H, W) uint8 of the light in ``picture``: gain, noise, rounding, and no more than white."""
    rows = uniforms(key, _DRAWS * frame, image.shape[0])
    factor, std = np.float32(gain(sensor, frame, key)), np.float32(sensor.noise_std)
    black, white, half = np.float32(0.0), np.float32(255.0), np.float32(0.5)
    for v in range(image.shape[0]):
        start = int(_NOISE_TILE * rows[v])
        source, noise, target = picture[v + PAD], sensor.noise[start : start + image.shape[1]], image[v]
        for u in range(image.shape[1]):
            value = factor * source[u + PAD] + std * noise[u]
            target[u] = np.uint8(np.int32(min(max(value, black), white) + half))
