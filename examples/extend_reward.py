"""A reward of your own: the gain of a potential."""

import math
from typing import Any


def accuracy(e: Any) -> float:
    """-log2 of the camera's true position error, against a centimetre [bit], and a bit for each landmark in the map."""
    return e.distinct_landmarks - math.log2(1.0 + e.position_error / 0.01)
