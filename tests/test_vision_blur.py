"""A fiducial in a blurred image: how fast it moves there, and the noise of where its corner is found."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of
from activeslam_gym.live.source import ROOM
from activeslam_gym.motion import transition
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.room.camera import RoomCamera, introduce_target
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.views import projected, speeds

from .vision_scene import CAMERA

SURE = np.diag(np.repeat((1e-4, 1e-3, 1e-2, 1e-2), 3) ** 2)


def moving(velocity: tuple[float, float, float], turn: np.ndarray) -> np.ndarray:
    """A camera at the origin that looks along z."""
    return np.concatenate((np.eye(1, 7, 3)[0], velocity, turn))


def test_speeds_are_those_of_the_pixels() -> None:
    points = np.array(((0.0, 0.0, 2.0), (0.5, -0.3, 1.5), (0.0, 0.0, -1.0)))
    camera, dt = moving((0.2, 0.1, -0.3), np.array((0.3, -0.8, 0.5))), 1e-5
    before = projected(CAMERA, camera, points[:2])
    after = projected(CAMERA, transition(camera, np.zeros(6), dt), points[:2])
    expected = [*np.linalg.norm(after - before, axis=1) / dt, 0.0]
    np.testing.assert_allclose(speeds(CAMERA, camera, points), expected, rtol=2e-3)


def mean_square(blur: float) -> float:
    """Of the corners of targets, seen by cameras that turn by 3 rad/s: error² over R, for each number."""
    squares = []
    for seed in range(4):
        camera, angle = RoomCamera(ROOM, camera_of(ROOM), np.random.SeedSequence(seed)), 0.5 * np.pi * seed + 0.7
        state = moving((0.0, 0.0, 0.0), 3.0 * np.array((np.cos(angle), np.sin(angle), 0.3)))
        before = transition(state, np.zeros(6), -ROOM.frame_time)
        filter = Filter(ROOM, fiducials=camera.fiducials, camera=before, covariance=SURE)
        front_end = FrontEnd(filter, replace(FrontEndSettings(), fiducial_blur=blur))
        introduce_target(front_end, camera.fiducials)
        front_end.step(camera.photograph(state, 1), ROOM.frame_time, np.zeros(6))
        found = front_end.candidates
        for one in found[found["id"] < 0]:
            error = one["pixel"] - camera.pixels(state, camera.fiducials[[-1 - one["id"]]])[0]
            squares.append(error @ np.linalg.solve(one["R"], error) / 2.0)
    assert len(squares) >= 12
    return float(np.mean(squares))


def test_a_corner_in_motion_blur_is_beside_its_place_and_its_noise_says_so() -> None:
    assert mean_square(0.0) > 1.5
    assert mean_square(FrontEndSettings.fiducial_blur) < 0.5
