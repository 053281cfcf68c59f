"""What the surfaces of a room look like: grey pictures from a generator, and a library of them as mip pyramids.

Pictures are drawn on the unit square, x to the right and y downwards. Every picture can be laid side by side with
itself: noise is periodic, and posters have a plain margin. Grey values are 0 to 255.

A picture is stored at SIZE, SIZE/2, …, 1 texels a side, each the mean of four of the one before (Williams, "Pyramidal
parametrics", SIGGRAPH 1983), so that a surface far away is read where its texels are as large as a pixel: without it
fine patterns would make corners that are not there, and that do not move as the surface does.

A texel holds the four greys that a bilinear look-up at it needs, its own and those to the right, below, and below on
the right, in one number of 32 bits: one load instead of four.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from activeslam_gym.vision.room.shading import SIZE

Pattern = Callable[[np.random.Generator, int], np.ndarray]  # a picture (n, n) [grey levels]

TARGET_MARGIN = 0.25
"""Share of the target's board on each side of its black rectangle: a corner's template lies on it at 2.9 m still."""


def value_noise(rng: np.random.Generator, n: int, across: int, down: int, octaves: int = 4) -> np.ndarray:
    """Periodic noise (n, n) of unit variance: random values on lattices, smoothly interpolated, halved every octave.

    It is worked out for every second point.
    """
    total = np.zeros((n // 2, n // 2))
    for octave in range(octaves):
        lattice = rng.standard_normal((down << octave, across << octave)) * 0.5**octave
        total += _smooth(_smooth(lattice, n // 2).T, n // 2).T
    return np.repeat(np.repeat((total - total.mean()) / total.std(), 2, 0), 2, 1)


def _smooth(lattice: np.ndarray, n: int) -> np.ndarray:
    """Rows (k, m) of the lattice interpolated to (n, m), with the weight 3 t^2 - 2 t^3; the last meets the first."""
    count = lattice.shape[0]
    at = (np.arange(n) + 0.5) * count / n
    below = at.astype(int)
    t = (at - below)[:, None]
    return lattice[below] + t * t * (3.0 - 2.0 * t) * (np.roll(lattice, -1, 0) - lattice)[below]


def _grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """x (1, n) and y (n, 1) of the picture's points."""
    at = (np.arange(n) + 0.5) / n
    return at[None, :], at[:, None]


def target(rng: np.random.Generator, n: int) -> np.ndarray:
    """A white board with a black rectangle: its corners are the fiducials."""
    x, y = _grid(n)
    inside = (np.abs(x - 0.5) < 0.5 - TARGET_MARGIN) & (np.abs(y - 0.5) < 0.5 - TARGET_MARGIN)
    return np.where(inside, 25.0, 225.0)


def plaster(rng: np.random.Generator, n: int) -> np.ndarray:
    """A poorly textured wall: hardly anything to hold on to."""
    return 178.0 + 3.0 * value_noise(rng, n, 3, 3, 3) + 1.5 * value_noise(rng, n, 40, 40, 2)


def bricks(rng: np.random.Generator, n: int) -> np.ndarray:
    """Eight courses of four bricks: the same corner again and again."""
    x, y = _grid(n)
    course = np.floor(8.0 * y)
    along = 4.0 * x + 0.5 * (course % 2.0)
    shade = rng.uniform(95.0, 140.0, (8, 4))[course.astype(int), np.floor(along).astype(int) % 4]
    joint = ((along % 1.0) < 0.05) | ((8.0 * y % 1.0) < 0.12)
    return np.where(joint, 185.0, shade) + 5.0 * value_noise(rng, n, 16, 16)


def wallpaper(rng: np.random.Generator, n: int) -> np.ndarray:
    """One motif in a grid of four by four, without any difference."""
    x, y = _grid(n)
    u, v = 4.0 * x % 1.0 - 0.5, 4.0 * y % 1.0 - 0.5
    petals = 0.28 + 0.12 * np.cos(rng.integers(4, 7) * np.arctan2(v, u))
    radius = np.hypot(u, v)
    return np.where(radius < 0.1, 105.0, np.where(radius < petals, 150.0, 190.0)) + 2.0 * value_noise(rng, n, 32, 32, 2)


def ceiling(rng: np.random.Generator, n: int) -> np.ndarray:
    """White panels with thin joints and specks."""
    x, y = _grid(n)
    joint = ((3.0 * x % 1.0) < 0.03) | ((3.0 * y % 1.0) < 0.03)
    specks = value_noise(rng, n, 64, 64, 2) > 2.2
    return np.where(joint, 120.0, np.where(specks, 165.0, 205.0)) + 2.0 * value_noise(rng, n, 4, 4)


def tiles(rng: np.random.Generator, n: int) -> np.ndarray:
    """Four by four floor tiles, each of its own grey."""
    x, y = _grid(n)
    shade = rng.uniform(90.0, 165.0, (4, 4))[(4.0 * y).astype(int), (4.0 * x).astype(int)]
    joint = ((4.0 * x % 1.0) < 0.025) | ((4.0 * y % 1.0) < 0.025)
    return np.where(joint, 60.0, shade) + 7.0 * value_noise(rng, n, 12, 12)


def planks(rng: np.random.Generator, n: int) -> np.ndarray:
    """Six boards of wood with their grain, each cut in two somewhere."""
    x, y = _grid(n)
    board = np.floor(6.0 * x).astype(int)
    piece = (y > rng.uniform(0.1, 0.9, 6)[board]).astype(int)
    cut = np.abs(y - rng.uniform(0.1, 0.9, 6)[board]) < 0.004
    gap = (6.0 * x % 1.0 < 0.03) | cut
    return np.where(gap, 45.0, rng.uniform(90.0, 150.0, (6, 2))[board, piece]) + 12.0 * value_noise(rng, n, 40, 4)


def carpet(rng: np.random.Generator, n: int) -> np.ndarray:
    """Blotches of every size."""
    return np.clip(110.0 + 30.0 * value_noise(rng, n, 10, 10), 15.0, 230.0)


def crate(rng: np.random.Generator, n: int) -> np.ndarray:
    """A wooden box with a frame, a label and stencilled signs."""
    picture = planks(rng, n)
    x, y = _grid(n)
    edge = np.maximum(np.abs(x - 0.5), np.abs(y - 0.5))
    picture = np.where(edge > 0.42, 75.0 + 10.0 * value_noise(rng, n, 8, 8), picture)
    picture = np.where(np.abs(edge - 0.42) < 0.006, 25.0, picture)
    left, top = rng.uniform(0.15, 0.45, 2)
    _rectangle(picture, left, top, left + 0.35, top + 0.2, 215.0)
    _text(picture, rng, left + 0.02, top + 0.03, left + 0.33, top + 0.18, 0.035)
    return picture


def books(rng: np.random.Generator, n: int) -> np.ndarray:
    """Three boards full of books."""
    picture = np.full((n, n), 35.0)
    for top in (0.0, 1.0 / 3.0, 2.0 / 3.0):
        x = 0.01
        while x < 0.97:
            right = min(x + rng.uniform(0.02, 0.07), 0.99)
            height = rng.uniform(0.20, 0.29)
            _rectangle(picture, x, top + 0.31 - height, right - 0.003, top + 0.31, rng.uniform(50.0, 220.0))
            if rng.random() < 0.7:
                band = top + 0.31 - height * rng.uniform(0.3, 0.9)
                _rectangle(picture, x, band, right - 0.003, band + 0.03, rng.uniform(30.0, 240.0))
            x = right
        _rectangle(picture, 0.0, top + 0.31, 1.0, top + 1.0 / 3.0, 140.0)
    return picture + 3.0 * value_noise(rng, n, 32, 32)


def poster(rng: np.random.Generator, n: int) -> np.ndarray:
    """Paper with a white margin: a picture of shapes on a cloudy ground, and some lines of text."""
    x, y = _grid(n)
    ground = np.clip(rng.uniform(60.0, 190.0) + rng.uniform(5.0, 35.0) * value_noise(rng, n, 3, 3, 5), 10.0, 245.0)
    picture = np.where((np.abs(x - 0.5) < 0.44) & (np.abs(y - 0.5) < 0.44), ground, 232.0)
    for _ in range(rng.integers(6, 14)):
        _shape(picture, rng, rng.uniform(10.0, 245.0))
    if rng.random() < 0.8:
        left, top = rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.6)
        _rectangle(picture, left - 0.02, top - 0.02, left + 0.47, top + 0.27, 225.0)
        _text(picture, rng, left, top, left + 0.45, top + 0.25, rng.uniform(0.03, 0.08))
    return picture


def _shape(picture: np.ndarray, rng: np.random.Generator, grey: float) -> None:
    """A turned rectangle, triangle, disc or ring of size 0.04 to 0.2, within the poster's margin."""
    n = picture.shape[0]
    size, angle = rng.uniform(0.04, 0.2), rng.uniform(0.0, 2.0 * np.pi)
    middle, ratio = rng.uniform(0.08, 0.92, 2), rng.uniform(0.3, 1.0)
    low = np.maximum(np.round((middle - 1.5 * size) * n), 0.08 * n).astype(int)
    high = np.minimum(np.round((middle + 1.5 * size) * n), 0.92 * n).astype(int)
    window = slice(low[1], high[1]), slice(low[0], high[0])
    x, y = _grid(n)
    dx, dy = x[:, window[1]] - middle[0], y[window[0]] - middle[1]
    u, v = dx * np.cos(angle) + dy * np.sin(angle), dy * np.cos(angle) - dx * np.sin(angle)
    radius = np.hypot(u, v)
    kinds = (
        np.maximum(np.abs(u), np.abs(v) / ratio) < size,
        np.maximum(-v, 0.5 * v + 0.87 * np.abs(u)) < 0.5 * size,
        radius < 0.8 * size,
        np.abs(radius - 0.8 * size) < 0.25 * size,
    )
    picture[window][kinds[rng.integers(len(kinds))]] = grey


def _text(
    picture: np.ndarray, rng: np.random.Generator, left: float, top: float, right: float, bottom: float, size: float
) -> None:
    """Lines of letter-like signs of height ``size``: each four strokes out of seven, as on a pocket calculator."""
    stroke, ink = 0.18 * size, rng.uniform(15.0, 60.0)
    for y in np.arange(top, bottom - size, 1.5 * size):
        for x in np.arange(left, right - 0.6 * size, 0.85 * size):
            if rng.random() < 0.15:
                continue  # the space between two words
            for kind in rng.permutation(7)[:4]:
                if kind < 3:  # lying, at the top, in the middle or at the bottom
                    level = y + 0.5 * kind * (size - stroke)
                    _rectangle(picture, x, level, x + 0.6 * size, level + stroke, ink)
                else:  # standing, left or right, in the upper or the lower half
                    column = x + (kind % 2) * (0.6 * size - stroke)
                    row = y + 0.5 * size * (kind > 4)
                    _rectangle(picture, column, row, column + stroke, row + 0.5 * size, ink)


def _rectangle(picture: np.ndarray, left: float, top: float, right: float, bottom: float, grey: float) -> None:
    """Fill a rectangle of the unit square."""
    n = picture.shape[0]
    rows = slice(max(round(top * n), 0), round(bottom * n))
    picture[rows, max(round(left * n), 0) : round(right * n)] = grey


_OVERSAMPLING = 2  # pictures are drawn so many times finer, then averaged: their hard edges become smooth
_COUNTS = {
    target: 1, plaster: 2, bricks: 1, wallpaper: 1, ceiling: 1,
    tiles: 1, planks: 2, carpet: 2, crate: 3, books: 2,
    poster: 16,
}  # fmt: skip
_DRAWN = [pattern for pattern, count in _COUNTS.items() for _ in range(count)]
"""The patterns of a library, in their order there."""


def texture_range(*kinds: Pattern) -> np.ndarray:
    """Where in a library the textures of these kinds are: indices."""
    return np.array([index for index, pattern in enumerate(_DRAWN) if pattern in kinds])


@cache
def texture_library() -> np.ndarray:
    """The textures (T, 2 SIZE, SIZE) uint32. Rooms share them: they are read only, and take about 16 MB.

    Level l, with s = SIZE / 2^l, has its texels in rows 2 (SIZE - s) … 2 (SIZE - s) + s - 1 and columns 0 … s - 1.
    """
    library = np.zeros((len(_DRAWN), 2 * SIZE, SIZE), np.uint32)
    for index, pattern in enumerate(_DRAWN):
        picture = pattern(np.random.default_rng([0, index]), _OVERSAMPLING * SIZE)
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
