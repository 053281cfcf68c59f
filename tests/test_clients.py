"""Learners of others, unmodified, on the environments: the scripts of `examples/`, small; with -m slow in full.

A client whose package is not installed is skipped; `make clients` installs each in an environment of its own.
"""

import json
import math
import re
import runpy
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym  # noqa: F401  (registers the environments)
from agents.task import Task, play_tasks

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
CLIENTS: dict[str, tuple[str, str, tuple[Any, ...], dict[str, Any]]] = {
    "sb3-ppo": ("sb3.py", "stable_baselines3", ("PPO",), {"steps": 8960}),
    "sb3-a2c": ("sb3.py", "stable_baselines3", ("A2C",), {"steps": 640}),
    "sb3-dqn": ("sb3.py", "stable_baselines3", ("DQN",), {"steps": 1200}),
    "sb3-recurrent-ppo": ("sb3.py", "sb3_contrib", ("RecurrentPPO",), {"steps": 2240}),
    "sb3-maskable-ppo": ("sb3.py", "sb3_contrib", ("MaskablePPO",), {"steps": 8960}),
    "sb3-zoo": ("rl_zoo3/train.py", "rl_zoo3", (), {"steps": 560, "num_envs": 4}),
    "torchrl-ppo": ("torchrl_ppo.py", "torchrl", (), {"steps": 560, "num_envs": 2}),
    "rllib-ppo": ("rllib_ppo.py", "ray.rllib", (), {"iterations": 1}),
    "cleanrl-ppo": ("cleanrl_ppo.py", "cleanrl", (), {"steps": 4480}),
}
"""A script, the package that it needs, arguments of its `main`, and more of them for the smallest run."""


LONG = ("sb3-a2c", "sb3-dqn")  # `sb3-ppo` runs the same script


@pytest.fixture(params=[pytest.param(one, marks=[pytest.mark.slow] if one in LONG else []) for one in CLIENTS])
def client(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, dict]:
    """The `main` of a client's script, in a folder of its own, and arguments for its smallest run."""
    script, package, arguments, smallest = CLIENTS[request.param]
    pytest.importorskip(package, reason=f"{package} is not installed: see make clients")
    monkeypatch.chdir(tmp_path)
    return partial(runpy.run_path(str(EXAMPLES / script))["main"], *arguments), smallest


def test_client_runs(client: tuple[Any, dict], capfd: pytest.CaptureFixture[str]) -> None:
    main, smallest = client
    returns = main(**smallest)
    assert len(returns) == 2
    assert all(math.isfinite(value) for value in returns)
    assert re.search(r"^\S.*: -?\d+ -> -?\d+ bits, \d+ steps in \d+ s$", capfd.readouterr().out, re.MULTILINE)


@pytest.mark.slow
def test_client_learns(client: tuple[Any, dict], capfd: pytest.CaptureFixture[str]) -> None:
    before, after = client[0]()
    with capfd.disabled():
        print(f"\n{capfd.readouterr().out.splitlines()[-1]}")
    assert after > before + 50.0


def test_a_checkpoint_of_rllib_plays_the_scenarios_that_it_learned_in(tmp_path: Path) -> None:
    pytest.importorskip("ray.rllib", reason="ray.rllib is not installed: see make clients")
    scenarios = ("sprint", "office")
    runpy.run_path(str(EXAMPLES / "rllib_ppo.py"))["main"](iterations=1, scenario=scenarios, out=tmp_path / "kept")
    name = f"rllib:{tmp_path / 'kept'}"
    for scenario in scenarios:
        settings = json.dumps({"duration": 2.0, "scenario": scenario})
        (alone,) = play_tasks([Task(name, 1, settings)])
        _, batched = play_tasks([Task(name, seed, settings) for seed in (0, 1)])
        np.testing.assert_array_equal(alone["actions"], batched["actions"])
    with pytest.raises(ValueError, match="tokens: .*allowed"):
        play_tasks([Task(name, 1, json.dumps({"duration": 2.0, "scenario": "hall"}))])


ZOO = sorted((EXAMPLES / "rl_zoo3").glob("*.yml"))
OF_THE_ZOO = ("n_envs", "n_timesteps", "policy", "env_kwargs", "normalize", "policy_kwargs", "learning_rate")
"""What rl_zoo3 reads by itself, or in a form of its own."""


@pytest.mark.parametrize("path", ZOO, ids=lambda path: path.stem)
def test_the_zoo_s_hyperparameters_are_those_of_the_algorithm(path: Path) -> None:
    """Each file is read, and makes a learner for each environment that it names."""
    yaml, sb3 = pytest.importorskip("yaml"), pytest.importorskip("stable_baselines3")
    known = {"ppo": "PPO", "a2c": "A2C", "dqn": "DQN", "trpo": "TRPO", "qrdqn": "QRDQN", "ppo_lstm": "RecurrentPPO"}
    learner = getattr(sb3, known[path.stem], None)
    learner = learner or getattr(pytest.importorskip("sb3_contrib"), known[path.stem])
    for name, told in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        env = gym.make(name, **told["env_kwargs"])
        rest = {key: value for key, value in told.items() if key not in OF_THE_ZOO}
        learner(told["policy"], env, **rest, device="cpu")
        assert set(told["normalize"]) == {"norm_obs", "norm_reward", "clip_reward"}
        assert re.fullmatch(r"(lin_)?[0-9.e+-]+", str(told["learning_rate"]))


def test_every_learner_s_script_is_tested() -> None:
    learners = [path for path in EXAMPLES.rglob("*.py") if " bits, {" in path.read_text(encoding="utf-8")]
    scripts = {path.relative_to(EXAMPLES).as_posix() for path in learners}
    assert scripts == {script for script, *_ in CLIENTS.values()}
