"""The wide-angle camera of equation 1: projection, back-projection and their Jacobians.

u_c = f x/z, v_c = f y/z, d = 1 + K_d (u_c^2 + v_c^2), u = u0 - u_c/sqrt(d), v = v0 - v_c/sqrt(d).
Camera axes are x left, y up, z forward, hence the minus signs; u runs to the right and v downwards.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, borrowing, compiled, constants, inlined
from activeslam_gym.motion import QUATERNION

Vector = np.ndarray | tuple[float, float, float]
"""Three numbers: an array (3,), or a tuple, which costs a kernel no allocation."""

CAMERA, camera_of = constants(
    Scenario(),
    focal=lambda s: s.focal_px,  # f k_u = f k_v [px]
    u0=lambda s: s.principal_x_px,
    v0=lambda s: s.principal_y_px,
    distortion="f8",  # K_d [1/px^2]
    width=lambda s: float(s.image_width),
    height=lambda s: float(s.image_height),
    minimum_depth="f8",  # points nearer than this are not seen [m]
    maximum_distance=lambda s: math.inf if s.maximum_distance is None else s.maximum_distance,  # nor farther ones [m]
    pixel_std="f8",  # of the image noise, each axis [px]
    command_known="b1",  # whether the motion is known between frames: see `slam.sight`
)
"""The lens, in pixels where nothing else is said; and the filter's model of the noise of its measurements."""


class View(NamedTuple):
    """A camera at a pose, and what may occlude its view."""

    lens: Record  # CAMERA
    pose: np.ndarray  # (>= 3,) begins with the position [m]
    R_WC: np.ndarray  # (3, 3) its rotation
    boxes: np.ndarray = np.zeros((0, 2, 3))  # (B, 2, 3) see `hidden`


@inlined
def view_of(lens: Record, pose: np.ndarray, boxes: np.ndarray) -> View:
    """The `View` of a camera whose ``pose`` (>= 7,) begins with position and quaternion."""
    return View(lens, pose[:], rotation_matrix(pose[QUATERNION]), boxes)  # [:]: one type for every length of a pose


@borrowing
def camera_from_world(R_WC: np.ndarray, v_W: Vector) -> tuple[float, float, float]:
    """R_WC^T v_W: the world vector (3,) in camera axes. A tuple, since this is where a frame spends its time."""
    return (
        R_WC[0, 0] * v_W[0] + R_WC[1, 0] * v_W[1] + R_WC[2, 0] * v_W[2],
        R_WC[0, 1] * v_W[0] + R_WC[1, 1] * v_W[1] + R_WC[2, 1] * v_W[2],
        R_WC[0, 2] * v_W[0] + R_WC[1, 2] * v_W[1] + R_WC[2, 2] * v_W[2],
    )


@borrowing
def world_from_camera(R_WC: np.ndarray, v_C: Vector) -> tuple[float, float, float]:
    """R_WC v_C: the camera's vector (3,) in world axes."""
    return (
        R_WC[0, 0] * v_C[0] + R_WC[0, 1] * v_C[1] + R_WC[0, 2] * v_C[2],
        R_WC[1, 0] * v_C[0] + R_WC[1, 1] * v_C[1] + R_WC[1, 2] * v_C[2],
        R_WC[2, 0] * v_C[0] + R_WC[2, 1] * v_C[1] + R_WC[2, 2] * v_C[2],
    )


@borrowing
def camera_point(R_WC: np.ndarray, pose: np.ndarray, y: Vector) -> tuple[float, float, float]:
    """p_C = R_WC^T (y - p) of the world point ``y`` (3,); ``pose`` begins with the position p."""
    return camera_from_world(R_WC, (y[0] - pose[0], y[1] - pose[1], y[2] - pose[2]))


@borrowing
def pixel_from_camera_point(lens: Record, p_C: Vector, z: np.ndarray) -> bool:
    """Project ``p_C`` (3,) [m] into ``z`` (2,) [px] (equation 1). False, with ``z`` untouched, behind the camera.

    With K_d < 0, a pincushion, directions with d <= 0 have no pixel either: they are beyond every image.
    """
    if p_C[2] <= 0.0:
        return False
    u_c = lens.focal * p_C[0] / p_C[2]
    v_c = lens.focal * p_C[1] / p_C[2]
    d = 1.0 + lens.distortion * (u_c * u_c + v_c * v_c)
    if d <= 0.0:
        return False
    root = math.sqrt(d)
    z[0] = lens.u0 - u_c / root
    z[1] = lens.v0 - v_c / root
    return True


@borrowing
def inside_image(lens: Record, z: np.ndarray, margin: float) -> bool:
    """Whether the pixel ``z`` (2,) lies inside the image grown by ``margin`` [px] on each side."""
    return -margin <= z[0] < lens.width + margin and -margin <= z[1] < lens.height + margin


@borrowing
def visible(view: View, y: np.ndarray, margin: float, z: np.ndarray) -> bool:
    """Whether the world point ``y`` (>= 3,) is in ``view``: the one test of visibility.

    It is where it lies in front of the camera and not too far away, its pixel in the image grown by ``margin`` [px] on
    each side, and none of the boxes between them. Writes the pixel into ``z`` (2,).
    """
    reached = in_field_of_view(view, (y[0], y[1], y[2]), margin, z)
    return reached and distance_between(view.pose, y) <= view.lens.maximum_distance


@borrowing
def in_field_of_view(view: View, y: tuple[float, float, float], margin: float, z: np.ndarray) -> bool:
    """`visible`, at any distance: what a filter asks, which knows the distance of ``y`` badly."""
    p_C = camera_point(view.R_WC, view.pose, y)
    if p_C[2] < view.lens.minimum_depth or not pixel_from_camera_point(view.lens, p_C, z):
        return False
    return inside_image(view.lens, z, margin) and not hidden(view.boxes, view.pose, y)


@borrowing
def distance_between(p: np.ndarray, y: np.ndarray) -> float:
    """|y - p| of two points (>= 3,) [m]."""
    return math.sqrt((y[0] - p[0]) ** 2 + (y[1] - p[1]) ** 2 + (y[2] - p[2]) ** 2)


@borrowing
def change_of_view(first: np.ndarray, now: np.ndarray, point: np.ndarray) -> float:
    """How differently ``point`` (3,) is seen from ``first`` (>= 3,) and from ``now`` (>= 3,) [rad].

    The angle between the lines of sight, and the logarithm of the ratio of the distances, as the two sides of a right
    angle. 0 where ``first`` is NaN.
    """
    if math.isnan(first[0]):
        return 0.0
    far, near = max(distance_between(first, point), 1e-9), max(distance_between(now, point), 1e-9)
    product = 0.0
    for i in range(3):
        product += (point[i] - first[i]) * (point[i] - now[i])
    return math.hypot(math.acos(min(max(product / (far * near), -1.0), 1.0)), math.log(near / far))


@borrowing
def hidden(boxes: np.ndarray, p: np.ndarray, y: Vector) -> bool:
    """Whether one of the ``boxes`` (B, 2, 3), lowest and highest corner [m], cuts the way from ``p`` to ``y`` (>= 3,).

    The way p + t (y - p) is in a box between two planes of each axis; it cuts the box where the three intervals of t
    and [0, 1] have more than a point in common, so that a point on a face is not hidden by its own box.
    """
    for b in range(boxes.shape[0]):
        near, far = 0.0, 1.0
        for i in range(3):
            way = y[i] - p[i]
            if abs(way) < 1e-12:
                if p[i] <= boxes[b, 0, i] or p[i] >= boxes[b, 1, i]:
                    far = -1.0
                continue
            first, second = (boxes[b, 0, i] - p[i]) / way, (boxes[b, 1, i] - p[i]) / way
            near, far = max(near, min(first, second)), min(far, max(first, second))
        if far - near > 1e-9:
            return True
    return False


@borrowing
def free_way(boxes: np.ndarray, margin: float, p: np.ndarray, way: np.ndarray) -> float:
    """How far one can go from ``p`` along ``way`` (3,), as a share of it, before a box grown by ``margin`` [m]: <= 1.

    In a grown box already, only a way out is free: one that leads away from the middle of the side that is nearest.
    """
    free = 1.0
    for b in range(boxes.shape[0]):
        near, far, shallow, inward = -math.inf, math.inf, math.inf, False
        for i in range(3):
            low, high = boxes[b, 0, i] - margin - p[i], boxes[b, 1, i] + margin - p[i]
            if min(-low, high) < shallow:
                shallow, inward = min(-low, high), (way[i] > 0.0) == (-low < high) and way[i] != 0.0
            if abs(way[i]) < 1e-12:
                if low >= 0.0 or high <= 0.0:
                    far = -math.inf
                continue
            first, second = low / way[i], high / way[i]
            near, far = max(near, min(first, second)), min(far, max(first, second))
        if shallow > 0.0:
            free = 0.0 if inward else free
        elif far - near > 1e-9 and near > -1e-9:
            free = min(free, max(near, 0.0))
    return free


@borrowing
def pixel_jacobian(lens: Record, p_C: Vector, J: np.ndarray) -> None:
    """Write d z / d p_C (2, 3) [px/m] at ``p_C``, which lies in front of the camera, into ``J``."""
    f_z = lens.focal / p_C[2]
    u_c, v_c = f_z * p_C[0], f_z * p_C[1]
    d = 1.0 + lens.distortion * (u_c * u_c + v_c * v_c)
    root = math.sqrt(d)
    bend = lens.distortion / (d * root)
    u_uc = -1.0 / root + bend * u_c * u_c
    u_vc = bend * u_c * v_c
    v_vc = -1.0 / root + bend * v_c * v_c
    J[0, 0], J[0, 1], J[0, 2] = u_uc * f_z, u_vc * f_z, -(u_uc * u_c + u_vc * v_c) / p_C[2]
    J[1, 0], J[1, 1], J[1, 2] = u_vc * f_z, v_vc * f_z, -(u_vc * u_c + v_vc * v_c) / p_C[2]


@compiled
def ray_from_pixel(lens: Record, z: np.ndarray) -> np.ndarray:
    """Back-project the pixel ``z`` (2,) to the camera point (x, y, 1) (3,) on its line of sight.

    With u_d = u0 - u and v_d = v0 - v: u_c = u_d / sqrt(1 - K_d (u_d^2 + v_d^2)), the inverse of equation 1. A pixel
    beyond the image of infinity (K_d r^2 >= 1; outside any sensible image) is taken just inside it.
    """
    u_d, v_d = lens.u0 - z[0], lens.v0 - z[1]
    e = max(1.0 - lens.distortion * (u_d * u_d + v_d * v_d), 1e-6)
    scale = 1.0 / (lens.focal * math.sqrt(e))
    return np.array((u_d * scale, v_d * scale, 1.0))


@compiled
def ray_jacobian(lens: Record, z: np.ndarray) -> np.ndarray:
    """d ray_from_pixel / d z, (3, 2) [1/px]; its last row is zero."""
    u_d, v_d = lens.u0 - z[0], lens.v0 - z[1]
    e = max(1.0 - lens.distortion * (u_d * u_d + v_d * v_d), 1e-6)
    scale = 1.0 / (lens.focal * math.sqrt(e))
    bend = scale * lens.distortion / e
    J = np.zeros((3, 2))
    J[0, 0] = -(scale + bend * u_d * u_d)
    J[0, 1] = -bend * u_d * v_d
    J[1, 0] = -bend * u_d * v_d
    J[1, 1] = -(scale + bend * v_d * v_d)
    return J
