"""A library of textures: pictures of surfaces as mip pyramids, packed for a quick look-up.

A picture is stored at SIZE, SIZE/2, …, 1 texels a side, each the mean of four of the one before (Williams, "Pyramidal
parametrics", SIGGRAPH 1983), so that a surface far away is read where its texels are as large as a pixel: without it
fine patterns would make corners that are not there, and that do not move as the surface does.

A texel holds the four greys that a bilinear look-up at it needs, its own and those to the right, below, and below on
the right, in one number of 32 bits: one load instead of four.
"""

import functools

import numpy as np

from activeslam_gym.vision.room import patterns
from activeslam_gym.vision.room.shading import SIZE

_OVERSAMPLING = 2  # pictures are drawn so many times finer, then averaged: their hard edges become smooth
_COUNTS = {
    patterns.target: 1, patterns.plaster: 2, patterns.bricks: 1, patterns.wallpaper: 1, patterns.ceiling: 1,
    patterns.tiles: 1, patterns.planks: 2, patterns.carpet: 2, patterns.crate: 3, patterns.books: 2,
    patterns.poster: 16,
}  # fmt: skip
_DRAWN = [pattern for pattern, count in _COUNTS.items() for _ in range(count)]
"""The patterns of a library, in their order there."""


def texture_range(*kinds: patterns.Pattern) -> np.ndarray:
    """Where in a library the textures of these kinds are: indices."""
    return np.array([index for index, pattern in enumerate(_DRAWN) if pattern in kinds])


@functools.lru_cache(maxsize=4)
def texture_library(seed: int = 0) -> np.ndarray:
    """The textures (T, 2 SIZE, SIZE) uint32 of a seed. Rooms share it: it is read only, and takes about 16 MB.

    Level l, with s = SIZE / 2^l, has its texels in rows 2 (SIZE - s) … 2 (SIZE - s) + s - 1 and columns 0 … s - 1.
    """
    library = np.zeros((len(_DRAWN), 2 * SIZE, SIZE), np.uint32)
    for index, pattern in enumerate(_DRAWN):
        picture = pattern(np.random.default_rng([seed, index]), _OVERSAMPLING * SIZE)
        write_pyramid(np.clip(_halved(picture), 0.0, 255.0), library[index])
    library.flags.writeable = False
    return library


def write_pyramid(picture: np.ndarray, out: np.ndarray) -> None:
    """All levels of ``picture`` (SIZE, SIZE) [grey levels] into ``out`` (2 SIZE, SIZE). Its edges are joined."""
    while True:
        s = picture.shape[0]
        grey = np.rint(picture).astype(np.uint32)
        below = np.roll(grey, -1, 0)
        quads = grey | np.roll(grey, -1, 1) << 8 | below << 16 | np.roll(below, -1, 1) << 24
        out[2 * (SIZE - s) : 2 * (SIZE - s) + s, :s] = quads
        if s == 1:
            return
        picture = _halved(picture)


def _halved(picture: np.ndarray) -> np.ndarray:
    """The mean of every two by two."""
    return 0.25 * (picture[::2, ::2] + picture[1::2, ::2] + picture[::2, 1::2] + picture[1::2, 1::2])
