"""Geometry of the page: the orthographic view, ellipses of covariances, the camera's frustum, the room.

The room is seen in orthographic projection, from behind and above the start, and not mirrored: the camera's left is
to the left. Under such a projection V (2 x 3), an ellipsoid of covariance P has an elliptic outline of covariance
V P Vᵀ, exactly; so the picture needs no 3-D engine, and a frame costs a few tens of milliseconds.
"""

import numpy as np
from scipy.spatial.transform import Rotation

_AZIMUTH, _ELEVATION = np.deg2rad((25.0, 37.0))
"""Of a viewer behind the start (at -Z), to its right, which is -X since the camera's x points left, and above it."""
TOWARDS_VIEWER = np.array(
    (-np.sin(_AZIMUTH) * np.cos(_ELEVATION), np.sin(_ELEVATION), -np.cos(_AZIMUTH) * np.cos(_ELEVATION))
)
_RIGHT = np.cross((0.0, 1.0, 0.0), TOWARDS_VIEWER) / np.cos(_ELEVATION)
VIEW = np.stack((_RIGHT, np.cross(TOWARDS_VIEWER, _RIGHT)))  # rows right and up (2, 3) of the page


def screen_from_world(points: np.ndarray) -> np.ndarray:
    """Orthographic projection of world points (..., 3) in metres to the page (..., 2), in metres too."""
    return points @ VIEW.T


# Ellipses and frustums ----------------------------------------------------------------------------------------------


def principal_axes(covariances: np.ndarray) -> np.ndarray:
    """A (n, d, d) with A Aᵀ = P, its columns the semi-axes of one sigma; tiny negative eigenvalues count as zero."""
    eigenvalues, eigenvectors = np.linalg.eigh(covariances)
    return eigenvectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]


def shortened(covariances: np.ndarray, longest: float) -> np.ndarray:
    """The covariances (n, d, d) with semi-axes of one sigma of at most `longest` [m]."""
    eigenvalues, eigenvectors = np.linalg.eigh(covariances)
    return (eigenvectors * np.minimum(eigenvalues, longest**2)[:, None, :]) @ np.swapaxes(eigenvectors, 1, 2)


def _circle(points: int) -> np.ndarray:
    """Cosine, sine and zero (3, points) of angles once round."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack((np.cos(angle), np.sin(angle), np.zeros(points)))


def ellipses(means: np.ndarray, covariances: np.ndarray, sigmas: float) -> np.ndarray:
    """Outlines (n, 48, 2) of the ellipses of means (n, 2) and covariances (n, 2, 2), at so many sigmas."""
    return means[:, None] + sigmas * np.swapaxes(principal_axes(covariances) @ _circle(48)[:2], 1, 2)


def ellipsoid_outlines(means: np.ndarray, covariances: np.ndarray, sigmas: float) -> np.ndarray:
    """Outlines (n, 48, 2) on the page of the ellipsoids of means (n, 3) and covariances (n, 3, 3) [m, m²]."""
    return ellipses(screen_from_world(means), VIEW @ covariances @ VIEW.T, sigmas)


def great_circles(means: np.ndarray, covariances: np.ndarray, sigmas: float) -> np.ndarray:
    """Three principal circles (3n, 32, 3) on each ellipsoid of means (n, 3), covariances (n, 3, 3)."""
    circles = np.stack([np.roll(_circle(32), axis, axis=0) for axis in range(3)])
    on_ellipsoid = np.swapaxes(principal_axes(covariances)[:, None] @ circles, 2, 3)
    return (means[:, None, None] + sigmas * on_ellipsoid).reshape(-1, 32, 3)


def camera_frustum(scenario, image_size, position, quaternion, depth: float) -> list[np.ndarray]:
    """Four triangles (3, 3) and the image rectangle (4, 3) in the world, m: a pinhole's view, distortion left out.

    `position` (3,) p_WC in m, `quaternion` (4,) q_WC, scalar first, `depth` of the rectangle in m.
    """
    width, height = image_size
    u, v = np.array([0, width, width, 0]), np.array([0, 0, height, height])
    # x left and y up, while u grows to the right and v downwards.
    x, y = (scenario.principal_x_px - u) / scenario.focal_px, (scenario.principal_y_px - v) / scenario.focal_px
    corners_C = depth * np.stack((x, y, np.ones(4)), axis=1)
    corners_W = position + Rotation.from_quat(quaternion, scalar_first=True).apply(corners_C)
    return [np.stack((position, corners_W[i], corners_W[i - 1])) for i in range(4)] + [corners_W]


# The room: `size` (3,) is its extent along X, Y, Z [m] --------------------------------------------------------------

_PLANES = np.array(
    [
        [(-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)],
        [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
        [(1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)],
    ]
)
"""Floor, far wall (+Z) and left wall (+X) of a cube about the origin: what the viewer sees from within."""


def room_planes(size: np.ndarray) -> np.ndarray:
    """Floor, far wall and left wall (3, 4, 3) [m]."""
    return _PLANES * size / 2


def box_faces(boxes: np.ndarray) -> np.ndarray:
    """The top and the two sides of ``boxes`` (B, 2, 3) that the viewer sees, (3 B, 4, 3), far boxes first."""
    boxes = boxes[np.argsort(boxes.mean(axis=1) @ TOWARDS_VIEWER)]
    middle, half = boxes.mean(axis=1), np.diff(boxes, axis=1)[:, 0] / 2
    return (middle[:, None, None] - _PLANES * half[:, None, None]).reshape(-1, 4, 3)


def room_edges(size: np.ndarray) -> np.ndarray:
    """The edges (9, 2, 3) of those planes; the three that would cross the foreground are left out."""
    pairs = np.stack((_PLANES, np.roll(_PLANES, 1, axis=1)), axis=2).reshape(-1, 2, 3)
    return np.array(sorted({tuple(sorted(map(tuple, pair))) for pair in pairs.tolist()})) * size / 2


def floor_grid(size: np.ndarray) -> np.ndarray:
    """Lines (k, 2, 3) on the floor, 1 m apart, or as many metres as keep them fewer than about twenty."""
    spacing = max(1.0, np.ceil(max(size) / 20))
    half_x, floor, half_z = size[0] / 2, -size[1] / 2, size[2] / 2
    xs, zs = (np.arange(np.ceil(-half / spacing), half / spacing) * spacing for half in (half_x, half_z))
    along_z = [[(x, floor, -half_z), (x, floor, half_z)] for x in xs]
    along_x = [[(-half_x, floor, z), (half_x, floor, z)] for z in zs]
    return np.array(along_z + along_x)
