"""A criterion of your own: how much the measurements at a motion's goal lower the variance of the camera's position."""

from typing import Any

import numpy as np


def position_variance(P: np.ndarray, sight: Any, pixel_var: float) -> float:
    """tr(P_p H^T S^-1 H P_p^T) [m^2], P_p the position's three rows of P."""
    return np.sum(sight.HP[:, :3] * np.linalg.solve(sight.S, sight.HP[:, :3]))
