"""`python -m agents watch`: animations and trajectories."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from PIL import Image  # noqa: E402

from agents.watching import command as watch  # noqa: E402
from agents.watching.film import side_by_side  # noqa: E402


def test_two_policies_are_shown_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "new" / "clip.gif"
    args = watch.Args(policy=("sweep", "stay"), duration=2.0, every=0.5, width=300, save=clip, tum=tmp_path / "tum")
    assert watch.main(args) == 0
    with Image.open(clip) as animation:
        assert animation.n_frames == 5 and animation.width == 600
        first = np.asarray(animation.convert("RGB"))
        animation.seek(4)
        assert (np.asarray(animation.convert("RGB")) != first).any()
    said = capsys.readouterr().out
    assert "sweep, room 1000000:" in said and f"Written to {clip}" in said
    poses = np.loadtxt(tmp_path / "tum" / "sweep-1000000-true.tum")
    assert poses.shape == (41, 8)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-6)


def test_a_shorter_film_stands_still_at_its_end() -> None:
    pictures = [np.full((4, 40, 3), value, np.uint8) for value in (10, 20, 30)]
    together = side_by_side([pictures, pictures[:1]], ["a", "b"])
    assert len(together) == 3
    assert together[2][-1, 0, 0] == 30 and together[2][-1, -1, 0] == 10
