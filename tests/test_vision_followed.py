"""The true point of a feature whose template shows several planes."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of
from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.slam.association import DETECTION
from activeslam_gym.vision.room.camera import FollowedPoints, RoomCamera
from activeslam_gym.vision.views import projected

LENS = camera_of(Scenario())
START = np.eye(1, 13, 3)[0]  # facing +Z


@pytest.mark.parametrize(("way", "which", "lasting"), [(0.4, 0, 0.0), (0.4, 1, 0.0), (0.02, 0, 0.6), (0.02, 0, -0.6)])
def test_at_a_crossing_the_true_point_is_that_which_the_pixels_followed(way: float, which: int, lasting: float) -> None:
    """A camera that moves ``way`` [m] to the right; matches have a noise of 0.2 px and a ``lasting`` error along it."""
    camera, rng, tried = RoomCamera(SCENARIOS["pixels"], LENS, np.random.SeedSequence(3)), np.random.default_rng(0), 0
    image = camera.photograph(START, 0)
    for id, pixel in enumerate(rng.integers((20, 20), (300, 220), (300, 2)).astype(float), start=1):
        points = camera.points(START, pixel, image)
        distances = np.linalg.norm(points, axis=1)
        if len(points) != 2 or distances.min() > 0.8 * distances.max():
            continue
        truth, found = FollowedPoints(camera), np.zeros(1, DETECTION)
        found["match"], found["pixel"] = id, pixel
        truth.look(START, image, found)
        np.testing.assert_array_equal(truth.of(np.array([id]))[0], points[0], "until there is a match, the likeliest")
        found["id"] = id
        for x in -np.linspace(0.0, way, 21)[1:]:
            moved = START + x * np.eye(1, 13)[0]
            found["pixel"] = projected(LENS, moved, points[which, None])[0] + rng.normal((lasting, 0.0), 0.2)
            truth.look(moved, image, found)
        np.testing.assert_array_equal(truth.of(np.array([id]))[0], points[which])
        tried += 1
    assert tried > 10
