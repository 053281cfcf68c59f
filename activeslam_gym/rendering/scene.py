"""What is shown of a snapshot, and in which colours; no drawing library needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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


def believed_points(snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The landmarks and, last, the camera: means (n, 3) [m], covariances (n, 3, 3) [m²] and colours (n,).

    Points without a finite mean and covariance, of a lost filter, are left out.
    """
    P, means = snapshot.covariance, np.concatenate((snapshot.landmarks, snapshot.position[None]))
    covariances = np.array([P[at : at + 3, at : at + 3] for at in (*range(_CAMERA_DIM, len(P), 3), 0)])
    colours = np.append(np.where(snapshot.mapped, MAPPED, INITIALISED), CAMERA)
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
