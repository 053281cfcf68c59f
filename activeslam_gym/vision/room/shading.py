"""The picture of a tile of the image: coverage by rectangles, and their textures filtered to the size of a pixel.

A tile of 16 by 8 pixels is a vector of 128; each step is one short loop over it, which the compiler turns into vector
instructions. All is in 32 bits and without ``fastmath``, so that every machine gives the same bits.
"""

import math

import numpy as np

from activeslam_gym.kernels import Record, compiled

TILE_WIDTH, TILE_HEIGHT = 16, 8
TILE = TILE_WIDTH * TILE_HEIGHT
SIZE = 256  # texels a side of a texture; a power of two
_LEVELS = SIZE.bit_length()  # of its pyramid

_ZERO, _HALF, _ONE, _QUARTER = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(0.25)
_TINY = np.float32(1e-20)
_LEAST = np.float32(1e-6)  # share of a pixel: less is at a plane's horizon, where squares of texels leave 32 bits

_X, _Y, _X_U, _X_V, _Y_V = range(0, 5 * TILE, TILE)  # vectors in ``rays``, see `render.Lens`
VECTORS = 11  # in ``floats``:
REST, COLOUR, _WEIGHT, _U, _V, _STEP_U, _STEP_V, _LEVEL, _RIGHT, _BELOW, _GREY = range(0, VECTORS * TILE, TILE)
"""The share of each pixel that is not covered yet, and its grey level so far; the share that the rectangle at hand
covers; its texel, the step to a probe, and the probes' level; where a probe is between four texels; twice its grey."""
_EXPONENT = np.int32(23)  # where it begins in a number of 32 bits; its bias is 127
_ONE_BITS, _HALF_LOG = np.int32(127 << 23), np.float32(0.5 / 2**23)
_GREATEST = np.float32(4.0 ** (_LEVELS - 3))  # square of the largest texel to be asked for: two levels are above it


@compiled
def add_rectangle(
    sight: Record, whole: bool, rays: np.ndarray, texture: np.ndarray, floats: np.ndarray, places: np.ndarray
) -> None:
    """Lay a rectangle under what a tile shows already. ``whole``: it is known to cover the tile.

    ``rays`` (5 TILE,), ``texture`` (2 SIZE^2,), ``floats`` (VECTORS TILE,) float32; ``places`` (TILE,) uint32: scratch.
    """
    H, low, high, brightness = sight.rows, sight.low, sight.high, np.float32(_HALF * sight.brightness)
    rows = (H[0, 0], H[0, 1], H[0, 2], H[1, 0], H[1, 1], H[1, 2], H[2, 0], H[2, 1], H[2, 2])
    limits = (low[0], high[0], low[1], high[1])
    if whole:
        floats[_WEIGHT : _WEIGHT + TILE] = floats[REST : REST + TILE]
    else:
        _cover(rows, limits, rays, floats)
        if floats[_WEIGHT : _WEIGHT + TILE].max() <= _ZERO:
            return
    _footprints(rows, limits, rays, floats)
    floats[_GREY : _GREY + TILE] = _ZERO
    for side in (-_ONE, _ONE):
        for coarser in range(2):
            _address(side, np.int32(coarser), floats, places)
            for i in range(TILE):
                places[i] = texture[places[i]]
            _blend(coarser == 1, places, floats)
    for i in range(TILE):
        floats[COLOUR + i] += floats[_WEIGHT + i] * (brightness * floats[_GREY + i])
        floats[REST + i] -= floats[_WEIGHT + i]


@compiled
def _cover(rows: tuple, limits: tuple, rays: np.ndarray, floats: np.ndarray) -> None:
    """The share of each pixel that the rectangle covers, of what is not covered yet, into the weights.

    Across each of its two directions a rectangle is an interval of texels, and a pixel another one, as wide as the
    texel changes from pixel to pixel: the share is that of their overlap. Shares of rectangles add up to one where
    two faces of a box meet, or one is seen beside the wall behind it, since both measure the distance to the same line.
    """
    u_x, u_y, u_1, v_x, v_y, v_1, w_x, w_y, w_1 = rows
    low_u, high_u, low_v, high_v = limits
    for i in range(TILE):
        x, y = rays[_X + i], rays[_Y + i]
        x_u, x_v, y_v = rays[_X_U + i], rays[_X_V + i], rays[_Y_V + i]
        w = w_x * x + w_y * y + w_1
        depth = _ONE / w
        u, v = (u_x * x + u_y * y + u_1) * depth, (v_x * x + v_y * y + v_1) * depth
        slope_x, slope_y = u_x - u * w_x, u_y - u * w_y
        a, b = slope_x * x_u + slope_y * x_v, slope_x * x_v + slope_y * y_v
        wide = math.sqrt(a * a + b * b + _TINY) * depth
        slope_x, slope_y = v_x - v * w_x, v_y - v * w_y
        a, b = slope_x * x_u + slope_y * x_v, slope_x * x_v + slope_y * y_v
        high = math.sqrt(a * a + b * b + _TINY) * depth
        across = (min(u + _HALF * wide, high_u) - max(u - _HALF * wide, low_u)) / wide
        down = (min(v + _HALF * high, high_v) - max(v - _HALF * high, low_v)) / high
        share = max(min(across, _ONE), _ZERO) * max(min(down, _ONE), _ZERO)
        floats[_WEIGHT + i] = min(share, floats[REST + i]) if w > _ZERO and share > _LEAST else _ZERO


@compiled
def _footprints(rows: tuple, limits: tuple, rays: np.ndarray, floats: np.ndarray) -> None:
    """Where in its texture each pixel is, and how large: two probes along its longer side, and their level.

    A pixel is an ellipse on the texture, with the axes of J J^T, where J = d(texel)/d(pixel) is the homography's
    derivative by the ray times the ray's by the pixel. The probes are as large as the ellipse is wide, or half as large
    as it is long, and set so that together they are as long as it is (an ellipse of ratio two is filtered
    exactly; McCormack et al., "Feline", SIGGRAPH 1999, uses more of them).
    """
    u_x, u_y, u_1, v_x, v_y, v_1, w_x, w_y, w_1 = rows
    low_u, high_u, low_v, high_v = limits
    for i in range(TILE):
        x, y = rays[_X + i], rays[_Y + i]
        x_u, x_v, y_v = rays[_X_U + i], rays[_X_V + i], rays[_Y_V + i]
        # zero where nothing is covered, so that the texel is one of the texture
        depth = _ONE / (w_x * x + w_y * y + w_1) if floats[_WEIGHT + i] > _ZERO else _ZERO
        u, v = (u_x * x + u_y * y + u_1) * depth, (v_x * x + v_y * y + v_1) * depth
        # J
        slope_x, slope_y = (u_x - u * w_x) * depth, (u_y - u * w_y) * depth
        u_across, u_down = slope_x * x_u + slope_y * x_v, slope_x * x_v + slope_y * y_v
        slope_x, slope_y = (v_x - v * w_x) * depth, (v_y - v * w_y) * depth
        v_across, v_down = slope_x * x_u + slope_y * x_v, slope_x * x_v + slope_y * y_v
        # J J^T, its eigenvalues and the vector of the greater one
        uu, vv = u_across * u_across + u_down * u_down, v_across * v_across + v_down * v_down
        uv = u_across * v_across + u_down * v_down
        mean, difference = _HALF * (uu + vv), _HALF * (uu - vv)
        root = math.sqrt(difference * difference + uv * uv)
        longer, shorter = mean + root, mean - root
        along_u = difference + root if difference >= _ZERO else uv
        along_v = uv if difference >= _ZERO else root - difference
        # two probes
        square = min(max(max(shorter, _QUARTER * longer), _ONE), _GREATEST)
        apart = max(_HALF * (math.sqrt(longer) - math.sqrt(square)), _ZERO)
        apart /= math.sqrt(along_u * along_u + along_v * along_v + _TINY)
        floats[_U + i], floats[_V + i] = min(max(u, low_u), high_u), min(max(v, low_v), high_v)
        floats[_STEP_U + i], floats[_STEP_V + i] = apart * along_u, apart * along_v
        # log2 of the probes' side, by the bits of its square: exact at the powers of two, and straight between them.
        # Half a level more: a ramp between two texels that is shorter than a pixel would shift edges by their phase
        floats[_LEVEL + i] = np.float32(np.int32(np.float32(square).view(np.int32) - _ONE_BITS)) * _HALF_LOG + _HALF


@compiled
def _address(side: np.float32, coarser: np.int32, floats: np.ndarray, places: np.ndarray) -> None:
    """Where the four texels around each probe are in the texture, at its level or the next; see `texture_library`."""
    for i in range(TILE):
        level = np.int32(np.int32(floats[_LEVEL + i]) + coarser)
        texels = np.int32(np.int32(SIZE) >> level)
        scale = np.int32(np.int32(np.int32(127) - level) << _EXPONENT).view(np.float32)  # 2^-level
        u = (floats[_U + i] + side * floats[_STEP_U + i]) * scale - _HALF
        v = (floats[_V + i] + side * floats[_STEP_V + i]) * scale - _HALF
        left, top = np.floor(u), np.floor(v)
        floats[_RIGHT + i], floats[_BELOW + i] = u - left, v - top
        column = np.int32(np.int32(left) & np.int32(texels - np.int32(1)))
        row = np.int32(np.int32(top) & np.int32(texels - np.int32(1)))
        start = np.int32(np.int32(2) * np.int32(np.int32(SIZE) - texels))
        places[i] = np.uint32(np.int32(np.int32(np.int32(start + row) * np.int32(SIZE)) + column))


@compiled
def _blend(coarser: bool, quads: np.ndarray, floats: np.ndarray) -> None:
    """Add the bilinear mean of four texels, in its share of the mean of two levels."""
    for i in range(TILE):
        quad = quads[i]
        here = np.float32(np.int32(quad & np.uint32(255)))
        beside = np.float32(np.int32((quad >> np.uint32(8)) & np.uint32(255)))
        below = np.float32(np.int32((quad >> np.uint32(16)) & np.uint32(255)))
        across = np.float32(np.int32(quad >> np.uint32(24)))
        right = floats[_RIGHT + i]
        upper, lower = here + right * (beside - here), below + right * (across - below)
        share = floats[_LEVEL + i] - np.floor(floats[_LEVEL + i])
        floats[_GREY + i] += (share if coarser else _ONE - share) * (upper + floats[_BELOW + i] * (lower - upper))
