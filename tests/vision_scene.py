"""A plane with a smooth texture and a target on it, seen through the lens: truth for the front end's tests."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.ndimage import zoom

from activeslam_gym.camera import camera_of
from activeslam_gym.geometry import quaternion_exp, quaternion_product, rotation_matrix
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.target import CORNERS, FACING, Board, Rectangle, printed, printed_value
from activeslam_gym.vision.track import HAND_HELD, UNSCALED
from activeslam_gym.vision.views import projected

LENS = Calibration(320, 240, 195.0, 162.0, 125.0, 1.8e-5)
CAMERA = camera_of(LENS.scenario())
TARGET = Rectangle(0.21, 0.1485, np.zeros((4, 2)))
CHARUCO = {"kind": "charuco", "columns": 5, "rows": 4, "square": 0.06, "marker": 0.045, "dictionary": "4x4_50"}


def pose_at(position: tuple[float, float, float], turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(7,) a camera at ``position`` [m] that faces the plane Z = 0, turned by the rotation vector ``turn`` [rad]."""
    return np.concatenate((position, quaternion_product(quaternion_exp(np.array(turn)), FACING)))


def path(count: int, distance: float = 0.7, approach: float = 0.002) -> list[np.ndarray]:
    """Poses of a hand that comes nearer by ``approach`` [m] an image."""
    wave = [(0.03 + 0.05 * math.sin(0.25 * k), 0.04 * (1 - math.cos(0.2 * k))) for k in range(count)]
    return [pose_at((x, y, distance - approach * k)) for k, (x, y) in enumerate(wave)]


def plane_points(pose: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, 2) where the rays of the pixels (x, y) (n,) meet the plane Z = 0 [m]: equation 1 backwards."""
    u_d, v_d = LENS.principal_x_px - x, LENS.principal_y_px - y
    scale = 1.0 / (LENS.focal_px * np.sqrt(1.0 - LENS.distortion * (u_d**2 + v_d**2)))
    rays = np.stack((u_d * scale, v_d * scale, np.ones_like(scale)), axis=-1) @ rotation_matrix(pose[3:]).T
    return pose[:2] - pose[2] * rays[..., :2] / rays[..., 2:]


def texture(X: np.ndarray) -> np.ndarray:
    """Grey values of the plane at X (..., 2) [m]: waves of many directions, the finest 25 mm long."""
    rng = np.random.default_rng(3)
    value = np.full(X.shape[:-1], 150.0)
    for _ in range(10):
        angle, length, phase = rng.uniform(0, math.pi), rng.uniform(0.025, 0.12), rng.uniform(0, 2 * math.pi)
        value += 15.0 * np.sin(2 * math.pi / length * (X @ np.array((math.cos(angle), math.sin(angle)))) + phase)
    return value


def with_target(X: np.ndarray) -> np.ndarray:
    """The plane with the dark target on a white sheet."""
    a, b = np.abs(X[..., 0]), np.abs(X[..., 1])
    value = np.where((a < 0.165) & (b < 0.135), 220.0, texture(X))
    return np.where((a < 0.5 * TARGET.width) & (b < 0.5 * TARGET.height), 40.0, value)


def photographed(pose: np.ndarray, grey: Callable[[np.ndarray], np.ndarray] = texture, samples: int = 4) -> np.ndarray:
    """The image (240, 320) uint8 of a plane of ``grey`` values, each pixel the mean of ``samples``^2 rays."""
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    y, x = np.mgrid[: LENS.image_height, : LENS.image_width].astype(float)
    total = sum(grey(plane_points(pose, x + dx, y + dy)) for dy in steps for dx in steps)
    return np.clip(np.rint(total / samples**2), 0, 255).astype(np.uint8)


def image_from(pose: np.ndarray, target: bool = False, samples: int = 4) -> np.ndarray:
    """The image of the textured plane, with the target or without."""
    return _image(tuple(pose.tolist()), target, samples).copy()


@cache
def _image(pose: tuple[float, ...], target: bool, samples: int) -> np.ndarray:
    return photographed(np.array(pose), with_target if target else texture, samples)


def covered(images: list[np.ndarray], first: int = 8) -> list[np.ndarray]:
    """The ``images``; from the ``first`` on with a sheet before most of the view, which goes to the right."""
    grey = np.random.default_rng(0).integers(0, 255, (20, 26)).astype(np.uint8)
    sheet, out = zoom(grey, (210 / 20, 270 / 26), order=3), [image.copy() for image in images]
    for k, image in enumerate(out[first:]):
        left = min(3 * k, 50)
        image[15:225, left : left + 270] = sheet
    return out


def target_fields(pose: np.ndarray) -> dict[str, object]:
    """The file of the target that the first image from ``pose`` shows."""
    corners = np.rint(projected(CAMERA, pose, TARGET.fiducials)).tolist()
    size = {"width": TARGET.width, "height": TARGET.height}
    return {"kind": "rectangle", **size, "corners_px": dict(zip(CORNERS, corners))}


def begun(image: np.ndarray, lens: Calibration = LENS) -> FrontEnd:
    """A front end without a target that has seen the first ``image``."""
    scenario = lens.scenario(**{**HAND_HELD, **UNSCALED})
    out = FrontEnd(Filter(scenario, camera=np.concatenate((np.zeros(3), FACING, np.zeros(6)))))
    out.start(image, 0.0, np.zeros(0, np.int64), np.zeros((0, 2)))
    return out


def board_on_the_plane(board: Board, pose: np.ndarray, samples: int = 4) -> np.ndarray:
    """The image (240, 320) uint8 of the board on a white sheet on the textured plane."""
    picture = printed(board)

    def grey(X: np.ndarray) -> np.ndarray:
        sheet, value = np.all(np.abs(X) < 0.5 * board.size + 0.02, axis=-1), printed_value(board, picture, X)
        return np.where(np.isnan(value), np.where(sheet, 220.0, texture(X)), 30.0 + 190.0 / 255.0 * value)

    return photographed(pose, grey, samples)


def enlarged(lens: Calibration, n: int) -> Calibration:
    """The lens of images with n x n pixels for each."""
    middle = ((at + 0.5) * n - 0.5 for at in lens[3:5])
    return Calibration(n * lens[0], n * lens[1], n * lens.focal_px, *middle, lens.distortion / n**2)
