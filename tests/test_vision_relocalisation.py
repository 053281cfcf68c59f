"""A lost map is found again."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.geometry import rotate_left, rotation_error  # noqa: E402
from activeslam_gym.vision.frontend import FrontEndSettings  # noqa: E402
from activeslam_gym.vision.relocalisation import locate  # noqa: E402
from activeslam_gym.vision.target import target_from  # noqa: E402
from activeslam_gym.vision.track import Track, follow, start  # noqa: E402
from activeslam_gym.vision.views import changes_of_view, projected  # noqa: E402

from .vision_scene import CAMERA, LENS, image_from, pose_at, target_fields  # noqa: E402

SEEN, AWAY = 30, 10
"""Images before the camera is covered, and while it is."""
BEFORE = [pose_at((0.05 * np.sin(0.2 * k), 0.06 * (1.0 - np.cos(0.15 * k)), 0.7)) for k in range(SEEN)]
TURNED = rotate_left(np.array((0.05, -0.3, 0.08)), BEFORE[-1][3:])
POSES = BEFORE + [np.concatenate((BEFORE[-1][:3] + (0.15 + 0.002 * k, -0.08, 0.05), TURNED)) for k in range(12)]
"""At last 18 cm and 18 degrees from where it was."""


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return [image_from(pose, target=True, samples=2) for pose in POSES]


def tracked(images: list[np.ndarray], **settings) -> Track:
    """A track from the target on."""
    frames = [(k / 30.0, image) for k, image in enumerate(images)]
    return follow(frames, LENS, target_from(target_fields(POSES[0])), 30.0, FrontEndSettings(**settings))


def errors(done: Track, poses: list[np.ndarray]) -> np.ndarray:
    """Of the positions of the last images [m]."""
    return np.linalg.norm(done.cameras[-len(poses) :, :3] - np.array(poses)[:, :3], axis=1)


def test_after_images_that_are_missing_the_map_is_found_again(images) -> None:
    done = tracked(images)
    found = [k for k, log in enumerate(done.logs, 1) if log.relocalised]
    assert len(found) == 1 and SEEN + 3 <= found[0] <= SEEN + 9, found
    assert errors(done, POSES[found[0] + 1 :]).max() < 0.02
    assert errors(done, POSES)[SEEN : found[0]].min() > 0.05, "it was lost"
    without = tracked(images, constellation=10**6, largest_area=2000.0)  # so that no search reaches so far
    assert not any(log.relocalised for log in without.logs)
    assert errors(without, POSES[-2:]).min() > 0.05, "the test is one that needs it"


def test_after_a_covered_lens_the_map_is_found_again(images) -> None:
    covered = [np.full((240, 320), 7, np.uint8)] * AWAY
    done = tracked(images[:SEEN] + covered + images[SEEN:])
    dark = done.logs[SEEN - 1 : SEEN - 1 + AWAY]
    assert sum(log.initialised + log.deletions for log in dark) == 0, "nothing is learnt in the dark"
    assert errors(done, POSES[-6:]).max() < 0.02


def test_a_loss_ends_with_a_constellation(images) -> None:
    """Fewer matches agree by chance, and would put new features where the camera is not."""
    end = start(images[0], LENS, target_from(target_fields(POSES[0])), 30.0)
    assert end._suffices(3) and not end._suffices(2)
    end._blind = end.settings.lost_after
    assert end._suffices(7) and not end._suffices(6)


def test_a_constellation_tells_the_pose_among_outliers() -> None:
    rng, truth = np.random.default_rng(4), POSES[5]
    points = rng.uniform((-0.3, -0.25, -0.2), (0.3, 0.25, 0.1), (9, 3))
    pixels = projected(CAMERA, truth, points) + 0.3 * rng.standard_normal((9, 2))
    ids = np.concatenate((np.arange(9), rng.integers(0, 20, 30)))
    outliers = rng.uniform((0, 0), (320, 240), (30, 2))
    elsewhere = np.concatenate((points, rng.uniform(-0.3, 0.3, (30, 3))))
    found = locate(CAMERA, ids, elsewhere, np.concatenate((pixels, outliers)), 7)
    assert found is not None
    assert np.linalg.norm(found[:3] - truth[:3]) < 0.01 and np.abs(rotation_error(truth[3:], found[3:])).max() < 0.01
    assert locate(CAMERA, ids[9:], elsewhere[9:], outliers, 7) is None, "outliers agree on nothing"
    assert locate(CAMERA, np.repeat(ids[:3], 3), points, pixels, 7) is None, "three features are no constellation"


def test_change_of_view_is_the_angle_and_the_logarithm_of_the_distance() -> None:
    first, points = np.zeros((3, 3)), np.array([(0.0, 0.0, 1.0)] * 3)
    now = np.array((np.sin(0.3), 0.0, 1.0 - np.cos(0.3)))
    np.testing.assert_allclose(changes_of_view(first, now, points), 0.3, rtol=1e-9)
    np.testing.assert_allclose(changes_of_view(first, np.array((0.0, 0.0, 0.5)), points), np.log(2.0), rtol=1e-9)
