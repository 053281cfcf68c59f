"""The study of `track` along recorded motions, small."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.geometry import rotation_error  # noqa: E402
from activeslam_gym.metrics import write_tum  # noqa: E402
from studies import excerpts  # noqa: E402


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A hand that sways, and turns a little, for 4 s."""
    times = np.arange(121) / 30.0
    positions = np.stack((0.2 * np.sin(times), np.full(121, 1.2), 0.1 * times), axis=1)
    looks = Rotation.from_rotvec(np.outer(0.2 * times, (0, 1, 0))) * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    write_tum(tmp_path / "path.tum", times, positions, np.roll(looks.as_quat(), 1, axis=1))
    return tmp_path / "path.tum"


def test_an_excerpt_begins_at_rest_at_unity_and_its_velocities_are_those_of_its_poses(path: Path) -> None:
    cameras = next(excerpts.excerpts(path, 4.0))
    np.testing.assert_allclose(cameras[0], np.eye(1, 13, 3)[0], atol=1e-9)
    steps = excerpts.RATE * np.diff(cameras[:, :3], axis=0)
    turns = [excerpts.RATE * rotation_error(b[3:7], a[3:7]) for a, b in zip(cameras, cameras[1:])]
    middle = 0.5 * (cameras[1:] + cameras[:-1])
    np.testing.assert_allclose(steps, middle[:, 7:10], atol=0.01)
    np.testing.assert_allclose(turns, middle[:, 10:], atol=0.01)


@pytest.mark.parametrize("lens", excerpts.LENSES)
def test_an_excerpt_is_tracked_through_every_lens(path: Path, lens: str) -> None:
    done = excerpts.flown(next(excerpts.excerpts(path, 3.0)), excerpts.LENSES[lens], excerpts.config.TRAINING_SEED)
    assert done is not None and not done.lost and done.error < 0.03 and max(done.nees) < 3.0
