"""The front end's memory of features, and which of them it deletes."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.slam.association import DETECTION, REJECTED
from activeslam_gym.slam.sight import MAP_POINT, Sight
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.target import target_from
from activeslam_gym.vision.templates import TemplateMap
from activeslam_gym.vision.track import follow

from .vision_scene import CAMERA, LENS, image_from, path, pose_at, target_fields

SETTINGS = FrontEndSettings(trials=10, most_residual=0.3)
PIXEL, HERE = np.array((160.0, 120.0)), pose_at((0.0, 0.0, 0.7))


@pytest.fixture(scope="module")
def grey() -> np.ndarray:
    return image_from(HERE, samples=1).astype(np.float32)


@pytest.fixture()
def gallery(grey) -> TemplateMap:
    """Features 7 and 8, and fiducial 0."""
    out = TemplateMap(CAMERA, SETTINGS, 4)
    for id in (7, 8, -1):
        out.add(id, grey, PIXEL, HERE, np.zeros(3), 0)
    return out


def search(gallery: TemplateMap, matched: set[int], frame: int, inside: bool = True) -> None:
    """All three are searched in the ``frame``; a feature is missed well ``inside`` the image, or at its edge."""
    ids = np.array([7, 8, -1])
    gallery.judge(ids, np.isin(ids, list(matched)), np.full(3, inside), frame)


def seen_at(
    gallery: TemplateMap, id: int, error: tuple[float, float], match: int | None = None, curvature: float = 0.0
) -> None:
    """One match of ``id``, so far [px] from where the updated estimate has it, with a noise of 0.1 px^2."""
    found, point = np.zeros(1, DETECTION), np.zeros(1, MAP_POINT)
    found["R"], point["curvature"] = 0.1 * np.eye(2), curvature * np.eye(2)
    found["id"], found["match"], found["pixel"] = id, id if match is None else match, PIXEL + error
    point["id"], point["z_hat"] = id, PIXEL
    gallery.remember_residuals(found, Sight(point, np.zeros((2, 12)), np.eye(2)))


def test_a_feature_is_proven_after_so_many_matches(gallery) -> None:
    for frame in range(9):
        assert gallery.proven(gallery.places([7, 8, -1])).tolist() == [False, False, True]
        search(gallery, {7}, frame)
    for frame in (9, 10):  # rounding decides at which of the two
        search(gallery, {7}, frame)
    assert gallery.proven(gallery.places([7, 8, -1])).tolist() == [True, False, True]


def test_what_comes_back_into_sight_has_to_prove_itself_again(gallery) -> None:
    """Where something else hides a feature, an edge of that may look like it."""
    for frame in range(20):
        search(gallery, {7, 8}, frame)
    for frame in range(20, 40):
        gallery.judge([8], np.array([frame % 9 > 0]), np.array([True]), frame)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [True, True], "nothing has come back"
    search(gallery, {7, 8}, 40)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [False, True], "8 was never away for long"
    for frame in range(41, 50):
        search(gallery, {7, 8}, frame)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [True, True]


@pytest.mark.parametrize("target", [True, False])
def test_new_features_pull_little_until_they_are_proven_where_a_target_is_known(target: bool) -> None:
    poses = path(20)
    frames = [(k / 30.0, image_from(pose, target=target, samples=1)) for k, pose in enumerate(poses)]
    known = target_from(target_fields(poses[0])) if target else None

    def noise(probation: float) -> np.ndarray:
        """The median tr R of features in the first image with searches, and of the same in the last."""
        found: list[np.ndarray] = []
        settings = FrontEndSettings(probation=probation, lens_std=0.0, residual_weight=0.0)
        follow(frames, LENS, known, 30.0, settings, watch=lambda end, *_: found.append(end.candidates.copy()))
        begun = next(one for one in found if (one["id"] > 0).any())
        first = begun["id"][begun["id"] > 0]
        own = [one[np.isin(one["id"], first)] for one in (begun, found[-1])]
        return np.array([np.median(np.trace(one["R"], 0, 1, 2)) for one in own])

    young, old = noise(5.0) / noise(1.0)
    assert (young > 15.0) == target and old == pytest.approx(1.0, rel=0.5)


def test_a_feature_fails_after_so_many_misses_inside_the_image(gallery) -> None:
    for frame in range(30):
        search(gallery, {8}, frame, inside=False)
    assert gallery.failed() == [], "misses at the edge tell nothing"
    for frame in range(30, 39):
        search(gallery, {8}, frame)
        assert gallery.failed() == []
    for frame in (39, 40):  # rounding decides at which of the two
        search(gallery, {8}, frame)
    assert gallery.failed() == [7], "8 is matched, and a fiducial is never judged"


def test_a_feature_whose_pixels_stay_beside_the_estimate_fails_and_one_that_shakes_does_not(gallery) -> None:
    for k in range(40):
        seen_at(gallery, 7, (1.3, 0.4))
        seen_at(gallery, 8, ((-1.0) ** k * 3.0, 0.0))
        seen_at(gallery, 8, (9.0, 9.0), match=REJECTED)
        seen_at(gallery, -1, (9.0, 0.0))
    assert gallery.failed() == [7]


@pytest.mark.parametrize("others, failed", [((0.05, 0.02), [7]), ((0.15, 0.15), []), ((0.5, 0.5), [])])
def test_one_alone_that_is_beside_the_estimate_fails_and_not_all_together(grey, others, failed) -> None:
    """Where all are beside it, as before their depths are known, the estimate is at fault."""
    gallery = TemplateMap(CAMERA, SETTINGS, 4)
    for id in (7, 8, 9):
        gallery.add(id, grey, PIXEL, HERE, np.zeros(3), 0)
    for frame in range(60):
        for id, error in zip((7, 8, 9), (0.5, *others)):
            seen_at(gallery, id, (error, 0.0))
        gallery.judge([7, 8, 9], np.ones(3, bool), np.ones(3, bool), frame)
    assert gallery.failed() == failed


def test_a_residual_that_the_linearisation_explains_counts_in_part(gallery) -> None:
    """The filter counts the terms that it leaves out 3 times, so 0.1 px^2 of them leave a quarter to the noise."""
    assert CAMERA.command_known
    seen_at(gallery, 7, (0.4, -0.8), curvature=0.1)
    np.testing.assert_allclose(gallery.residuals(gallery.places([7])), [(0.01, -0.02)], rtol=1e-12)
    for _ in range(200):
        seen_at(gallery, 7, (0.0, 1.0), curvature=0.1)
    assert gallery.failed() == []
