"""A lost map is found again."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of  # noqa: E402
from activeslam_gym.geometry import quaternion_exp, quaternion_product, rotation_error  # noqa: E402
from activeslam_gym.vision.frontend import FrontEndSettings  # noqa: E402
from activeslam_gym.vision.relocalisation import Views, locate  # noqa: E402
from activeslam_gym.vision.target import target_from  # noqa: E402
from activeslam_gym.vision.track import Track, follow  # noqa: E402
from activeslam_gym.vision.views import change_of_view, projected  # noqa: E402

from .vision_scene import LENS, TARGET, image_from, pose_at  # noqa: E402

CAMERA = camera_of(LENS.scenario())
SEEN, AWAY = 30, 10
"""Images before the camera is covered, and while it is."""


def before(k: int) -> np.ndarray:
    return pose_at((0.05 * np.sin(0.2 * k), 0.06 * (1.0 - np.cos(0.15 * k)), 0.7))


def after(k: int) -> np.ndarray:
    """Where nobody expects it: 18 cm and 18 degrees from where it was."""
    last = before(SEEN - 1)
    turned = quaternion_product(quaternion_exp(np.array((0.05, -0.3, 0.08))), last[3:])
    return np.concatenate((last[:3] + (0.15, -0.08, 0.05) + np.array((0.002, 0.0, 0.0)) * k, turned))


@pytest.fixture(scope="module")
def poses() -> list[np.ndarray]:
    return [before(k) for k in range(SEEN)] + [after(k) for k in range(12)]


@pytest.fixture(scope="module")
def images(poses) -> list[np.ndarray]:
    return [image_from(pose, target=True, samples=2) for pose in poses]


def tracked(images: list[np.ndarray], **settings) -> Track:
    """A track from the target on."""
    corners = np.rint(projected(CAMERA, before(0), TARGET.fiducials)).tolist()
    names = ("top_left", "top_right", "bottom_left", "bottom_right")
    target = target_from(
        {"kind": "rectangle", "width": TARGET.width, "height": TARGET.height, "corners_px": dict(zip(names, corners))}
    )
    frames = [(k / 30.0, image) for k, image in enumerate(images)]
    return follow(frames, LENS, target, 30.0, FrontEndSettings(**settings))


def errors(done: Track, poses: list[np.ndarray]) -> np.ndarray:
    """Of the positions of the last images [m]."""
    truth = np.array([pose[:3] for pose in poses])
    return np.linalg.norm(done.cameras[-len(truth) :, :3] - truth, axis=1)


def test_after_images_that_are_missing_and_not_told_of_the_map_is_found_again(images, poses) -> None:
    done = tracked(images)
    found = [k for k, log in enumerate(done.logs, 1) if log.relocalised]
    assert len(found) == 1 and SEEN + 3 <= found[0] <= SEEN + 9, found
    assert errors(done, poses[found[0] + 1 :]).max() < 0.02
    lost = np.linalg.norm(done.cameras[SEEN : found[0], :3] - [pose[:3] for pose in poses[SEEN : found[0]]], axis=1)
    assert lost.min() > 0.05, "it was lost"
    without = tracked(images, constellation=10**6)
    assert not any(log.relocalised for log in without.logs)
    assert errors(without, poses[-2:]).min() > 0.05, "the test is one that needs it"


def test_after_a_covered_lens_the_map_is_found_again(images, poses) -> None:
    covered = [np.full((240, 320), 7, np.uint8)] * AWAY
    done = tracked(images[:SEEN] + covered + images[SEEN:])
    dark = done.logs[SEEN - 1 : SEEN - 1 + AWAY]
    assert sum(log.births + log.deletions for log in dark) == 0, "nothing is learnt in the dark"
    assert errors(done, poses[-6:]).max() < 0.02


def test_a_constellation_tells_the_pose_among_strangers() -> None:
    rng, truth = np.random.default_rng(4), before(5)
    points = rng.uniform((-0.3, -0.25, -0.2), (0.3, 0.25, 0.1), (9, 3))
    pixels = projected(CAMERA, truth, points) + 0.3 * rng.standard_normal((9, 2))
    ids = np.concatenate((np.arange(9), rng.integers(0, 20, 30)))
    strangers = rng.uniform((0, 0), (320, 240), (30, 2))
    elsewhere = np.concatenate((points, rng.uniform(-0.3, 0.3, (30, 3))))
    found = locate(CAMERA, ids, elsewhere, np.concatenate((pixels, strangers)), 7)
    assert found is not None
    assert np.linalg.norm(found[:3] - truth[:3]) < 0.01 and np.abs(rotation_error(truth[3:], found[3:])).max() < 0.01
    assert locate(CAMERA, ids[9:], elsewhere[9:], strangers, 7) is None, "strangers agree on nothing"
    assert locate(CAMERA, np.repeat(ids[:3], 3), points, pixels, 7) is None, "three things are no constellation"


def test_views_are_the_newest_and_some_that_lie_apart() -> None:
    views = Views([])
    for k in range(100):
        views.remember(pose_at((0.02 * k, 0.0, 0.7)))
    along = [float(pose[0]) for pose in views.poses]
    assert along[-1] == pytest.approx(1.98) and 6 <= len(along) <= 10
    assert np.diff(along[:-1]).min() > 0.2
    assert views.nth(0) is views.poses[-1] and views.nth(len(along)) is views.poses[-1]
    for k in range(100):
        views.remember(pose_at((k, 0.0, 0.7)))
    assert len(views.poses) == 24


def test_change_of_view_is_the_angle_and_the_logarithm_of_the_distance() -> None:
    first, points = np.zeros((3, 3)), np.array([(0.0, 0.0, 1.0)] * 3)
    now = np.array((np.sin(0.3), 0.0, 1.0 - np.cos(0.3)))
    np.testing.assert_allclose(change_of_view(first, now, points), 0.3, rtol=1e-9)
    np.testing.assert_allclose(change_of_view(first, np.array((0.0, 0.0, 0.5)), points), np.log(2.0), rtol=1e-9)
