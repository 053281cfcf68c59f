"""Where a new feature is worth it: good corners (Shi and Tomasi 1994) in the parts of the image that have few."""

import numpy as np

from activeslam_gym.kernels import compiled
from activeslam_gym.vision.opencv import opencv

_CELLS = (4, 5)  # rows and columns of the cells whose features are counted
_BLOCK = 7  # side of the window over which gradients are summed [px]
_MEETING = (_BLOCK // 2 + 1,) * 2, (-1, -1), (1, 10, 0.0)  # window, no hole, 10 rounds (1: counted) of `cornerSubPix`


def new_corners(
    image: np.ndarray, occupied: np.ndarray, count: int, radius: float, border: int, least: float
) -> np.ndarray:
    """Up to ``count`` pixels (n, 2) of ``image`` (h, w) uint8 for new features, the best first.

    Each is the strongest corner of the cell that has the fewest features, at least ``radius`` pixels from the
    ``occupied`` pixels (m, 2) and from each other, ``border`` pixels inside the image, of strength ``least`` or more.
    It is the pixel where the edges meet (Foerstner and Guelch 1987): the strength is nearly the same wherever the
    window holds the corner, and a pixel beside the feature moves otherwise when the view changes.
    """
    cv2 = opencv()
    _, strength = cv2.threshold(cv2.cornerMinEigenVal(image, _BLOCK, ksize=3), least, 0.0, cv2.THRESH_TOZERO)
    h, w = image.shape
    strength[:border], strength[h - border :] = 0.0, 0.0
    strength[:, :border], strength[:, w - border :] = 0.0, 0.0
    crowd = np.zeros(_CELLS)
    _take(strength, crowd, np.asarray(occupied, float), radius)
    found: list[tuple[int, int]] = []
    while len(found) < count and (pixel := _strongest_in_thinnest(strength, crowd)) is not None:
        x, y = np.rint(cv2.cornerSubPix(image, np.array([[pixel]], np.float32), *_MEETING))[0, 0].astype(int).tolist()
        if strength[y, x] <= 0.0:
            x, y = pixel
        found.append((x, y))
        _take(strength, crowd, np.array([[x, y]], float), radius)
    return np.array(found, float).reshape(-1, 2)


@compiled
def _take(strength: np.ndarray, crowd: np.ndarray, pixels: np.ndarray, radius: float) -> None:
    """Count features at ``pixels`` (n, 2), and leave no corner near them."""
    (h, w), (rows, columns) = strength.shape, crowd.shape
    for k in range(pixels.shape[0]):
        x, y = pixels[k, 0], pixels[k, 1]
        top, left = max(int(y - radius), 0), max(int(x - radius), 0)
        strength[top : max(int(y + radius) + 1, 0), left : max(int(x + radius) + 1, 0)] = 0.0
        if 0 <= x < w and 0 <= y < h:
            crowd[int(y * rows / h), int(x * columns / w)] += 1


def _strongest_in_thinnest(strength: np.ndarray, crowd: np.ndarray) -> tuple[int, int] | None:
    """(x, y) of the strongest corner left in the cell with the fewest features that has one."""
    h, w = strength.shape
    rows, columns = crowd.shape
    for cell in np.argsort(crowd, axis=None, kind="stable"):
        i, j = divmod(int(cell), columns)
        top, left = -(-i * h // rows), -(-j * w // columns)
        part = strength[top : -(-(i + 1) * h // rows), left : -(-(j + 1) * w // columns)]
        y, x = divmod(int(part.argmax()), part.shape[1])
        if part[y, x] > 0.0:
            return left + x, top + y
    return None
