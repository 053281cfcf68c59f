"""Which images count as lost, and the reasons that are given."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.vision.diagnosis import Diagnosis, blemish
from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.track import follow

from .vision_scene import LENS, image_from, path, photographed, texture

IMAGE = image_from(path(1)[0], samples=2)
KNOWN, VAGUE = np.ones(20, bool), np.zeros(20, bool)


def log(searched: int, found: int, matched: int) -> FrameLog:
    return FrameLog(1.0, 20, searched, found, matched, found - matched, 0, 0, False, True, False, True, 1.0)


def advice(image: np.ndarray, target: bool = True, mapped: np.ndarray = KNOWN, tracked: int = 0, **counts: int) -> str:
    diagnosis = Diagnosis()
    diagnosis.add(image, log(**counts), mapped, tracked)
    return diagnosis.advice(target)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"image": IMAGE // 30, "searched": 20, "found": 0, "matched": 0}, "dark"),
        ({"image": np.full_like(IMAGE, 180), "searched": 20, "found": 0, "matched": 0}, "no corners"),
        ({"image": IMAGE, "searched": 20, "found": 18, "matched": 0}, "the calibration is of this lens"),
        ({"image": IMAGE, "searched": 20, "found": 18, "matched": 0, "tracked": 50}, "too quick a motion"),
        ({"image": IMAGE, "searched": 0, "found": 0, "matched": 0}, "more images a second"),
        ({"image": IMAGE, "searched": 20, "found": 1, "matched": 0}, "blur"),
    ],
)
def test_the_reason_is_that_of_the_image_and_its_counts(given: dict[str, Any], said: str) -> None:
    assert said in advice(**given) and ";" not in advice(**given)


def test_a_remedy_is_suggested_where_it_may_help() -> None:
    counts = {"searched": 20, "found": 1, "matched": 0}
    assert "a target in the first image may help" in advice(IMAGE, target=False, **counts)
    assert "turning gives no depth" in advice(IMAGE, mapped=VAGUE, **counts)
    assert blemish(IMAGE) == ""


def mapped_part(pose: np.ndarray) -> np.ndarray:
    return image_from(pose, samples=2)


def another_part(pose: np.ndarray) -> np.ndarray:
    """Its waves have other directions: those of a part far away fit the map's again after a shift of two pixels."""
    return photographed(pose, lambda X: texture(1.37 * X[..., ::-1]), 2)


@pytest.mark.parametrize(("view", "remains_lost"), [(mapped_part, False), (another_part, True)])
def test_images_are_lost_until_the_map_is_seen_again(view: Any, remains_lost: bool) -> None:
    """After darkness, the camera sees the mapped part of the plane, or another."""
    rng, poses = np.random.default_rng(1), path(12)
    images = [mapped_part(pose) for pose in poses]
    images += [rng.integers(0, 12, IMAGE.shape, np.uint8) for _ in range(5)] + [view(poses[11])] * 6
    done = follow([(k / 30.0, image) for k, image in enumerate(images)], LENS, None, 30.0)
    assert not done.lost[:12].any() and done.lost[12:17].all() and done.lost[-1] == remains_lost
