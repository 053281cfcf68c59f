"""What a camera in a hand meets: a target that comes near, or is blurred; views without anything known."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of
from activeslam_gym.live.source import ROOM
from activeslam_gym.motion import transition
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.drawing import as_first_seen
from activeslam_gym.vision.frontend import FrontEnd, FrontEndSettings
from activeslam_gym.vision.room.camera import RoomCamera, introduce_target
from activeslam_gym.vision.target import Board, target_from
from activeslam_gym.vision.track import Track, follow
from activeslam_gym.vision.views import projected
from tests.vision_scene import (
    CAMERA,
    CHARUCO,
    LENS,
    TARGET,
    begun,
    board_on_the_plane,
    image_from,
    path,
    pose_at,
    target_fields,
)

NEARER = [pose_at((0.03 * np.sin(0.2 * k), 0.0, 0.8 - 0.009 * k)) for k in range(60)]
"""From 80 to 27 cm."""


def tracked(poses: list[np.ndarray], images: list[np.ndarray], **settings) -> tuple[Track, list[set[int]]]:
    """A track from the target on, and the fiducials that were matched in each image."""
    matched: list[set[int]] = []

    def watch(end: FrontEnd, *_) -> None:
        matched.append({int(id) for id in end.candidates["match"] if -4 <= id < 0})

    frames = [(k / 30.0, image) for k, image in enumerate(images)]
    known = target_from(target_fields(poses[0]))
    return follow(frames, LENS, known, 30.0, FrontEndSettings(**settings), watch=watch), matched


def errors(done: Track, poses: list[np.ndarray]) -> np.ndarray:
    """Of the positions [m]."""
    return np.linalg.norm(done.cameras[:, :3] - np.array(poses)[:, :3], axis=1)


def test_a_target_is_found_at_a_third_of_its_first_distance() -> None:
    images = [image_from(pose, target=True, samples=2) for pose in NEARER]
    done, matched = tracked(NEARER, images)
    assert all(len(one) >= 3 for one in matched[-8:]), matched[-8:]
    assert errors(done, NEARER)[-8:].max() < 0.003
    as_at_first = tracked(NEARER, images, redrawn=np.inf)[1]
    assert not any(as_at_first[-5:]), "its first looks do not do there"


@pytest.mark.parametrize("target", [TARGET, target_from(CHARUCO)], ids=["rectangle", "board"])
def test_a_target_looks_as_it_is_drawn_from_elsewhere(target) -> None:
    first, now = pose_at((0.02, 0.0, 0.6)), pose_at((-0.06, 0.03, 0.33), (0.1, -0.2, 0.2))
    fiducials = target.fiducials if target is TARGET else target.points
    image = board_on_the_plane(target, now) if isinstance(target, Board) else image_from(now, target=True)
    for k, expected in enumerate(projected(CAMERA, now, fiducials)):
        picture, pixel = as_first_seen(CAMERA, target, first, fiducials, now, k)
        np.testing.assert_allclose(pixel, expected, atol=1e-9)
        known = np.isfinite(picture)
        assert known.any() and not known.all()
        assert np.corrcoef(picture[known], image[known])[0, 1] > 0.99


@pytest.fixture()
def under_way() -> FrontEnd:
    """After 20 images without a target."""
    poses = path(20, 0.4)
    end = begun(image_from(poses[0], samples=2))
    for k, pose in enumerate(poses[1:], 1):
        end.step(image_from(pose, samples=2), k / 30.0)
    return end


def test_where_nothing_known_is_in_view_new_features_are_initialised(under_way) -> None:
    for id in under_way.filter.ids.tolist():
        under_way._forget(id)
    last, logs = image_from(path(21, 0.4)[-1], samples=2), []
    for k in range(3):
        logs.append(under_way.step(last, (20 + k) / 30.0))
    assert logs[0].searched == 0 and sum(log.initialised for log in logs) > 0


SURE = np.diag(np.repeat((1e-4, 1e-3, 1e-2, 1e-2), 3) ** 2)


def moving(velocity: tuple[float, float, float], turn: np.ndarray) -> np.ndarray:
    """A camera at the origin that looks along z."""
    return np.concatenate((np.eye(1, 7, 3)[0], velocity, turn))


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
