"""Which features are searched where there is no time for all."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.vision.selection import most_telling  # noqa: E402
from activeslam_gym.vision.settings import FrontEndSettings  # noqa: E402
from activeslam_gym.vision.track import follow  # noqa: E402

from .vision_scene import LENS, image_from, path  # noqa: E402


def test_the_next_is_always_the_one_that_tells_most_given_those_before() -> None:
    rng, v, count = np.random.default_rng(0), 30, 8
    H, allowed = rng.standard_normal((2 * v, 20)), rng.random(v) < 0.9
    R = np.array([np.diag(rng.uniform(0.1, 2.0, 2)) for _ in range(v)])
    S, blocks = H @ H.T, [slice(2 * a, 2 * a + 2) for a in range(v)]
    for a in range(v):
        S[blocks[a], blocks[a]] += R[a]

    def left(a: int, before: list[int]) -> float:
        """The information of a's pixel, by Schur's complement."""
        rows = np.concatenate([np.arange(2 * b, 2 * b + 2) for b in before] or [np.zeros(0, int)])
        cross = S[blocks[a]][:, rows]
        own = S[blocks[a], blocks[a]] - cross @ np.linalg.solve(S[np.ix_(rows, rows)], cross.T)
        return float(np.linalg.det(own) / np.linalg.det(R[a]))

    chosen: list[int] = []
    for _ in range(count):
        chosen.append(max((a for a in range(v) if allowed[a] and a not in chosen), key=lambda a: left(a, chosen)))
    assert np.flatnonzero(most_telling(S, R, allowed, count)).tolist() == sorted(chosen)
    np.testing.assert_array_equal(most_telling(S, R, allowed, v), allowed)


def test_no_more_features_are_searched_than_there_is_time_for() -> None:
    images = [(k / 30.0, image_from(pose, samples=2)) for k, pose in enumerate(path(12))]
    few, many = (follow(images, LENS, None, 30.0, FrontEndSettings(searched=n), features=150).logs for n in (10, 99))
    assert max(log.searched for log in few) <= 10 < max(log.searched for log in many)
    assert not any(log.lost for log in few)


@pytest.mark.parametrize("features", [19, 501, 49.0, None])
def test_a_map_of_no_sensible_size_is_refused(features: int) -> None:
    with pytest.raises(ValueError, match="features must be a whole number from 20 to 500, got"):
        follow([(0.0, image_from(path(1)[0], samples=2))], LENS, None, 30.0, features=features)
