"""What is shown of a snapshot, where it lies on the page, and in which colours; no drawing library needed.

The room is seen in orthographic projection, from behind and above the start, and not mirrored: the camera's left is
to the left. Under such a projection V (2 x 3), an ellipsoid of covariance P has an elliptic outline of covariance
V P Vᵀ, exactly; so the picture needs no 3-D engine, and a frame costs a few tens of milliseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from activeslam_gym.envs.snapshot import Snapshot

# Okabe and Ito's colours, safe for colour-blind readers: blue is believed, black is true, green is known, vermillion is
# the camera.
MAPPED, INITIALISED, EXPECTED = "#0072B2", "#7CC4F0", "#B0B4B8"
TRUTH, FIDUCIAL, CAMERA = "#1A1A1A", "#009E73", "#D55E00"
TEXT, MUTED, GRID, FLOOR, WALL = "#1F2328", "#6B7280", "#DFE3E8", "#F3F5F7", "#F9FAFB"
ELLIPSOID_SIGMAS, GATE_SIGMAS = 2.0, 3.0
"""Standard deviations drawn: of a landmark in the map, of a prediction in the image."""
LONGEST = 1.0
"""Greatest half-length of an ellipsoid in the map [m]: the depth of a new feature is very uncertain."""
_CAMERA_DIM = 12  # rows of the camera in the snapshot's covariance; three of each landmark follow
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


def camera_frustum(scenario, position, quaternion, depth: float) -> list[np.ndarray]:
    """Four triangles (3, 3) and the image rectangle (4, 3) in the world, m: a pinhole's view, distortion left out.

    `position` (3,) p_WC in m, `quaternion` (4,) q_WC, scalar first, `depth` of the rectangle in m.
    """
    width, height = scenario.image_width, scenario.image_height
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


# What is shown ------------------------------------------------------------------------------------------------------


def believed_points(snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The landmarks and, last, the camera: means (n, 3) [m], covariances (n, 3, 3) [m²] and colours (n,).

    Points without a finite mean and covariance, of a lost filter, are left out.
    """
    P, means = snapshot.belief.covariance, np.concatenate((snapshot.belief.landmarks, snapshot.belief.position[None]))
    covariances = np.array([P[at : at + 3, at : at + 3] for at in (*range(_CAMERA_DIM, len(P), 3), 0)])
    colours = np.append(np.where(snapshot.belief.mapped, MAPPED, INITIALISED), CAMERA)
    finite = _are_finite(means, covariances)
    return means[finite], covariances[finite], colours[finite]


def predicted_pixels(snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    """Predicted measurements, as far as finite: means (m, 2) [px] and covariances (m, 2, 2) [px²]."""
    finite = _are_finite(snapshot.predicted, snapshot.predicted_covariance)
    return snapshot.predicted[finite], snapshot.predicted_covariance[finite]


def _are_finite(means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Which (n,) of the means (n, d) and covariances (n, d, d) have no NaN and no infinity."""
    return np.isfinite(means).all(1) & np.isfinite(covariances).all((1, 2))


def command_text(motion: str, gaze: str) -> str:
    """'⊗ FORWARD · gaze LEFT': an arrow as seen in the image, ⊗ into it and ⊙ out of it, and the command's names."""
    arrow = {"FORWARD": "⊗ ", "BACKWARDS": "⊙ ", "RIGHT": "→ ", "LEFT": "← ", "UP": "↑ ", "DOWN": "↓ "}.get(motion, "")
    return f"{arrow}{motion} · gaze {gaze}"
