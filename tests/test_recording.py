"""Rerun recordings: what the file holds, read back with Rerun's own tools."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import activeslam_gym  # noqa: F401
import baselines
from activeslam_gym.evaluation import Episode, run_episode
from agents.recording import Recording, ellipsoid_axes
from agents.watching import command as watch

SHORT: dict[str, Any] = {"gaze_period": 0.5, "duration": 3.0}


def test_ellipsoid_axes_are_those_of_the_covariance() -> None:
    A = np.random.default_rng(0).standard_normal((20, 3, 3))
    P = A @ np.swapaxes(A, 1, 2)
    half, quaternions = ellipsoid_axes(P, 2.0)
    R = Rotation.from_quat(quaternions).as_matrix()
    np.testing.assert_allclose(R @ (0.25 * half[:, :, None] ** 2 * np.swapaxes(R, 1, 2)), P, atol=1e-9)
    flat, quaternions = ellipsoid_axes(np.diag([1.0, 1.0, 0.0])[None], 2.0)
    np.testing.assert_allclose(np.sort(flat[0]), [0.0, 2.0, 2.0])
    assert np.isfinite(quaternions).all()


def test_without_rerun_the_message_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    scenario = gym.make("ActiveSLAM-v0").unwrapped.scenario
    with pytest.raises(ImportError, match=r"pip install -e '\.\[rerun\]'"):
        Recording(tmp_path / "a.rrd", scenario)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Episode]:
    """A file, and the episode that it shows."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (the extra rerun)")
    path = tmp_path_factory.mktemp("recording") / "deep" / "sweep.rrd"
    env = gym.make("ActiveSLAM-v0", **SHORT)
    with Recording(path, env.unwrapped.scenario) as recording:
        return path, run_episode(env, baselines.make("sweep", env), 3, looks=[recording.log])


def rerun(*arguments: str | Path) -> str:
    """What Rerun's command line says of a file; a failure where it refuses it."""
    done = subprocess.run([sys.executable, "-m", "rerun", *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_the_file_is_whole_and_holds_every_thing(recorded: tuple[Path, Episode]) -> None:
    path, _ = recorded
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    rerun("rrd", "verify", path)
    told, belief = rerun("rrd", "print", path), "camera camera/predicted camera/detected path ellipsoids expected"
    entities = [f"/world/belief/{name}" for name in belief.split()]
    entities += "/world/room /world/fiducials /world/truth/camera /world/truth/path /world/truth/landmarks".split()
    entities += "/entropy /log2_det/total /position/error /position/two_sigma /command".split()
    assert not [entity for entity in entities if entity not in told]


def column(path: Path, entity: str, name: str) -> dict[float, list[float]]:
    """What an entity's component was at each time [s], read back."""
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no reader of chunks")
    found: dict[float, list[float]] = {}
    for one in chunk.RrdReader(path).stream().to_chunks():
        if one.entity_path == entity and not one.is_static:
            batch = one.to_record_batch()
            times = batch.column("time").cast("int64").to_pylist()
            found |= {time / 1e9: value for time, value in zip(times, batch.column(name).to_pylist(), strict=True)}
    return found


def test_curves_and_poses_read_back_are_the_episode(recorded: tuple[Path, Episode]) -> None:
    path, episode = recorded
    entropy = column(path, "/entropy", "Scalars:scalars")
    assert sorted(entropy) == pytest.approx(np.arange(0.0, 3.01, 0.5))
    np.testing.assert_allclose(np.ravel([entropy[time] for time in sorted(entropy)]), episode.entropy)
    for whose, positions in (("truth", episode.true_position), ("belief", episode.estimated_position)):
        told = column(path, f"/world/{whose}/camera", "Transform3D:translation")
        np.testing.assert_allclose(np.reshape([told[time] for time in sorted(told)], (-1, 3)), positions, atol=1e-6)


def test_lost_and_interrupted_runs_are_recorded_and_watch_records_each_policy(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (the extra rerun)")
    env = gym.make("ActiveSLAM-v0", **SHORT, lost_position_error=1e-3)
    lost, interrupted = tmp_path / "lost.rrd", tmp_path / "interrupted.rrd"
    with Recording(lost, env.unwrapped.scenario) as file:
        assert run_episode(env, baselines.make("sweep", env), 0, looks=[file.log]).lost
    with pytest.raises(KeyboardInterrupt), Recording(interrupted, env.unwrapped.scenario) as file:
        file.log(env, env.reset(seed=0)[1])
        raise KeyboardInterrupt
    file.close()
    args = watch.Args(policies=("sweep", "stay"), duration=1.0, gaze_period=0.25, rerun=tmp_path / "w.rrd")
    assert watch.main(args) == 0
    names = ("interrupted", "lost", "w-stay", "w-sweep")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{name}.rrd" for name in names]
    for path in tmp_path.iterdir():
        rerun("rrd", "verify", path)
