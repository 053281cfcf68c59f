"""Episodes on a cluster of Ray: `make client-cluster`, three nodes on this machine."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import config
from activeslam_gym.evaluation import Store, cluster
from agents import task as tasks
from agents.__main__ import main
from agents.learn.weights import SHIPPED
from agents.task import Task
from tests.support import assert_same_record

ROOT = Path(__file__).parents[2]
SHORT = json.dumps({"duration": 1.0})
MODULE = """
import os
import baselines
from . import beside
from activeslam_gym.config import SCENARIOS, Scenario

SCENARIOS["noisier"] = Scenario(pixel_std=beside.pixel_std)

def information(P, sight, pixel_var):
    return 0.0

class Mine:
    def __init__(self, env):
        assert "working_dir" in __file__ and "working_dir" in beside.__file__, __file__
        self.env, self.policy = env.unwrapped, baselines.make("stay", env)
    def predict(self, *arguments, **named):
        return self.policy.predict(*arguments, **named)

class Raises(Mine):
    def predict(self, *arguments, **named):
        if self.env.np_random_seed == 2:
            raise KeyError("two")
        return super().predict(*arguments, **named)

class Ends(Mine):
    def predict(self, *arguments, **named):
        if self.env.np_random_seed == 1:
            os._exit(3)
        return super().predict(*arguments, **named)
"""


@pytest.fixture(scope="module")
def nodes() -> Iterator[Any]:
    """Three nodes of a core each."""
    pytest.importorskip("ray", reason="Ray is not installed: see make client-cluster")
    from ray.cluster_utils import Cluster

    paths = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), *([paths] if paths else [])])
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    yield cluster
    import ray

    ray.shutdown()
    cluster.shutdown()


def assert_equal(store: Path, other: Path, count: int) -> None:
    """Two folders of so many episodes are equal to the bit."""
    names = sorted(path.relative_to(store) for path in store.rglob("*.npz"))
    assert names == sorted(path.relative_to(other) for path in other.rglob("*.npz")) and len(names) == count
    for name in names:
        with np.load(store / name) as one, np.load(other / name) as two:
            assert_same_record(dict(one), dict(two))


def test_a_comparison_equals_that_of_one_machine_though_a_node_is_lost(nodes: Any, tmp_path: Path) -> None:
    line = "compare --policies sweep mi-fisher random ppo --scenario paper office corner --duration 4 --no-figures"
    line += f" --episodes {os.environ.get('EPISODES', 60)} --reference sweep"
    victim = nodes.add_node(num_cpus=1)
    episodes = 12 * int(os.environ.get("EPISODES", 60))

    def lose() -> None:
        while len(list((tmp_path / "a").rglob("*.npz"))) < episodes // 4:
            time.sleep(0.1)
        nodes.remove_node(victim)

    thread = Thread(target=lose, daemon=True)
    thread.start()
    assert main([*line.split(), "--cluster", nodes.address, "--out", str(tmp_path / "a")]) == 0
    thread.join(60)
    assert not thread.is_alive()
    assert main([*line.split(), "--out", str(tmp_path / "b"), "--jobs", "2"]) == 0
    assert_equal(tmp_path / "a", tmp_path / "b", episodes)


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A package of a user's own; its policies work where they were sent alone."""
    (tmp_path / "own" / "of_mine").mkdir(parents=True)
    (tmp_path / "own" / "of_mine" / "__init__.py").write_text(MODULE)
    (tmp_path / "own" / "of_mine" / "beside.py").write_text("pixel_std = 3.0\n")
    monkeypatch.syspath_prepend(tmp_path / "own")
    yield "of_mine"
    config.SCENARIOS.pop("noisier", None)
    for name in ("of_mine", "of_mine.beside"):
        sys.modules.pop(name, None)


def test_one_s_own_modules_weights_and_scenarios_travel(
    nodes: Any, own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    weights = Path("below", "policy.npz")
    weights.parent.mkdir()
    weights.write_bytes((SHIPPED / "ppo.npz").read_bytes())
    weights.with_suffix(".json").write_bytes((SHIPPED / "ppo.json").read_bytes())
    model = weights.with_name("model.zip")
    stable_baselines3 = pytest.importorskip("stable_baselines3")
    stable_baselines3.PPO("MlpPolicy", gym.make("ActiveSLAM-v0")).save(model)
    names = (f"{own}:Mine", str(weights), str(model))
    parts = {"pixel_std": 4.0, "motion_criterion": f"{own}:information"}
    settings = [json.dumps({"duration": 1.0, "scenario": one}) for one in (f"{own}:noisier", parts)]
    wanted = [Task(name, 1, one) for name in names for one in settings]
    found = dict(tasks.results(wanted, Store(workers=nodes.address)))
    from_weights = [task for task in wanted if task.policy == str(weights)]
    from_model = [Task(str(model), 1, settings[0])]  # in a process of its own, which imports the module
    for played in (from_weights, from_model):
        for task, episode in tasks.results(played, Store()):
            np.testing.assert_array_equal(found[task].entropy, episode.entropy)
    assert len(found) == 6


@pytest.mark.parametrize(
    ("how", "error", "told"),
    [("Raises", ValueError, "KeyError: 'two'.*episode 2"), ("Ends", OSError, "episode 1: .*lost twice")],
)
def test_an_episode_that_fails_is_named_and_all_others_are_played(
    how: str, error: type[Exception], told: str, nodes: Any, own: str
) -> None:
    wanted, found = [Task(f"{own}:{how}", seed, SHORT) for seed in range(6)], []
    with pytest.raises(error, match=f"{how}.*{told}"):
        found.extend(task.seed for task, _ in tasks.results(wanted, Store(workers=nodes.address)))
    assert sorted(found) == [seed for seed in range(6) if seed != (2 if how == "Raises" else 1)]


def test_a_node_with_another_installation_is_named_and_plays_nothing(
    nodes: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """That of another processor plays, and is named."""
    monkeypatch.setattr(cluster, "processor", lambda: "the one here")
    (tmp_path / "numba-0.1.dist-info").mkdir()
    (tmp_path / "numba-0.1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: numba\nVersion: 0.1\n")
    paths = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])
    other = nodes.add_node(num_cpus=2, env_vars={"PYTHONPATH": paths})
    try:
        wanted = [Task("stay", seed, SHORT) for seed in range(40)]
        assert len(dict(tasks.results(wanted, Store(workers=nodes.address)))) == 40
        assert "its installation differs: numba 0.1 → " in (told := capsys.readouterr().err)
        assert told.count("has another processor") == 1
    finally:
        nodes.remove_node(other)


@contextmanager
def head() -> Iterator[subprocess.Popen]:
    """A cluster of one core, by the command of Ray."""
    command = [str(Path(sys.executable).with_name("ray")), "start", "--head", "--block", "--port=6392", "--num-cpus=1"]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.Popen(command, env=env, stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert any("Ray runtime started" in line for line in run.stdout or ())
        yield run
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.communicate()


def test_a_lost_head_is_told_and_the_same_command_goes_on_with_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    line = "compare --policies stay sweep --reference stay --episodes 40 --duration 20 --no-figures --resume"
    there = f"{line} --cluster 127.0.0.1:6392"
    command = [sys.executable, "-m", "agents", *there.split(), "--out", str(tmp_path / "a")]
    with head() as first:
        run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        while len(list((tmp_path / "a" / "episodes").glob("*.npz"))) < 10:
            assert run.poll() is None, run.communicate()[0]
            time.sleep(0.1)
        os.killpg(first.pid, signal.SIGKILL)
        told = run.communicate(timeout=100)[0]
    assert run.returncode == 2 and "--cluster: the head is lost, and what is over is kept" in told
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "a" / "episodes").glob("*.npz")}
    with head():
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0 and f"{len(before)} of 80 episodes are kept" in done.stdout, done.stderr
    assert before.items() <= {path: path.stat().st_mtime_ns for path in before}.items()  # none is played twice
    assert main([*line.split(), "--jobs", "1", "--out", str(tmp_path / "b")]) == 0
    assert_equal(tmp_path / "a", tmp_path / "b", 80)


@pytest.mark.slow
def test_the_job_script_of_slurm_starts_a_cluster_and_plays(tmp_path: Path) -> None:
    """With a stand-in for srun, which runs its command on this machine."""
    pytest.importorskip("ray")
    (tmp_path / "srun").write_text('#!/bin/bash\nwhile [[ $1 == --* ]]; do shift; done\nexec "$@"\n')
    (tmp_path / "srun").chmod(0o755)
    python = Path(sys.executable)
    told = {"SLURM_NNODES": "2", "SLURM_CPUS_ON_NODE": "1", "PYTHON": str(python), "PORT": "6391"}
    env = {**os.environ, **told, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    line = "-m agents compare --cluster auto --policies stay --reference stay --episodes 4 --duration 1 --no-figures"
    script = ROOT / "examples" / "slurm" / "cluster.sbatch"
    done = subprocess.run(
        ["bash", str(script), *line.split(), "--out", str(tmp_path / "out")],
        cwd=ROOT, env=env, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out" / "episodes").glob("*.npz"))) == 4
