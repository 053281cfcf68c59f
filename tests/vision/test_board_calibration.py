"""A person who follows the guidance waves a rendered board, and the lens is known."""

import json
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import parser
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.live import source as live_source
from activeslam_gym.live.device import Device
from activeslam_gym.live.run import source_of
from activeslam_gym.live.source import GuidanceError
from activeslam_gym.vision.board import BOARD, BoardCalibration
from activeslam_gym.vision.calibration import read_calibration
from activeslam_gym.vision.drawing import printed, printed_value
from tests import vision_scene
from tests.vision.test_sizes import enlarged
from tests.vision_scene import photographed, pose_at

LENS = enlarged(vision_scene.LENS, 2)
PICTURE = printed(BOARD)
PLACES = {"upper left": (-1, 1), "upper right": (1, 1), "lower left": (-1, -1), "lower right": (1, -1)}
TILTS = {"left": (0, 1), "right": (0, -1), "top": (1, 0), "bottom": (-1, 0)}


def board_from(pose: np.ndarray) -> np.ndarray:
    def grey(X: np.ndarray) -> np.ndarray:
        value = printed_value(BOARD, PICTURE, X)
        return np.where(np.isnan(value), 200.0, 30.0 + 190.0 / 255.0 * value)

    return photographed(pose, grey, 2)


def held(words: str, rng: np.random.Generator) -> np.ndarray:
    """The pose of the camera before the board that one who hears the ``words`` brings about."""
    x, y = next((0.05 * np.array(at) for name, at in PLACES.items() if name in words), rng.uniform(-0.02, 0.02, 2))
    turn = next((at for name, at in TILTS.items() if f"its {name}" in words), rng.uniform(-0.7, 0.7, 2))
    pose = pose_at((0.0, 0.0, 0.0), (*(-0.55 * np.array(turn)), 0.0))
    pose[:3] = -rotation_matrix(pose[3:]) @ (-x, y, rng.uniform(0.36, 0.42))
    return pose


def test_one_who_follows_the_guidance_calibrates_and_the_lens_is_used_at_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(vision_scene, "LENS", LENS)
    monkeypatch.setattr(Device, "_warm_up", lambda self: None)
    monkeypatch.setattr(live_source, "start", lambda image, calibration, target, *_, **__: (calibration, target))
    source, rng, heard, started = (
        Device(None, None, 5.0, tmp_path / "lens.json"),
        np.random.default_rng(2**32),
        [""],
        None,
    )
    with pytest.raises(GuidanceError, match="Calibration: Hold the board"):
        source.start(np.full((480, 640), 128, np.uint8))
    while started is None and len(heard) < 80:
        if len(heard) % 2:  # each pose is held for two images
            image = board_from(held(heard[-1], rng))
        try:
            started = source.start(image)
        except GuidanceError as guidance:
            heard.append(str(guidance))
    assert started is not None, heard
    fit, target = started
    assert target == BOARD and read_calibration(tmp_path / "lens.json") == fit and not source.calibrating
    assert source.scenario.focal_px == fit.reduced(fit.scale).focal_px
    assert fit.focal_px == pytest.approx(LENS.focal_px, rel=0.01)
    assert fit.distortion == pytest.approx(LENS.distortion, rel=0.1)
    assert np.hypot(fit.principal_x_px - LENS.principal_x_px, fit.principal_y_px - LENS.principal_y_px) < 4.0
    told = {name for name in (*PLACES, *TILTS) if any(name in one for one in heard)}
    assert told & set(PLACES) and told & set(TILTS)


def test_a_board_that_moves_fast_or_not_at_all_gives_no_view(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vision_scene, "LENS", LENS)
    here, there = (board_from(pose_at((x, 0.0, 0.4))) for x in (0.0, 0.05))
    board_calibration = BoardCalibration()
    assert [board_calibration.add(image) for image in (here, there, here)] == ["Move more slowly (0 views so far)."] * 3
    assert all("(1 views so far)" in board_calibration.add(here) for _ in range(3)) and board_calibration.fit is None


def test_the_command_takes_a_known_lens_or_calibrates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(Device, "_warm_up", lambda self: None)
    lens = tmp_path / "lens.json"
    lens.write_text(json.dumps(LENS._asdict()))
    for option, calibrates in (("--calibration", False), ("--calibrate", True)):
        source = source_of(parser().parse_args(["live", "--source", "browser", option, str(lens)]))
        assert isinstance(source, Device) and source.calibrating == calibrates
