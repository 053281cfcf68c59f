"""The worked examples of the manual: each runs, and does what its page says."""

import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym import SCENARIOS, Gaze
from activeslam_gym.evaluation import run_episode
from agents.policies import load
from baselines.greedy import Greedy
from examples.extend_policy import look_around

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = [path for path in sorted((ROOT / "examples").glob("extend_*.py")) if "__main__" in path.read_text()]
EXAMPLES += [ROOT / "examples" / "fisher_trace.py", ROOT / "examples" / "record_rerun.py"]
NEEDS = {"record_rerun": "rerun", "extend_smoother": "gtsam", "extend_mesh": "embreex"}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem], reason=f"the extra of {NEEDS[path.stem]} is not installed")
    with np.printoptions():
        runpy.run_path(str(path), run_name="__main__")
    SCENARIOS.pop("tunnel", None)
    assert capsys.readouterr().out.strip()


def test_the_policy_plays_one_or_many_and_joins_the_comparison() -> None:
    one = gym.make("ActiveSLAM-v0", duration=4.0)
    many = gym.make_vec("ActiveSLAM-v0", num_envs=3)
    for env, shape in ((one, (2,)), (many, (3, 2))):
        observation, _ = env.reset(seed=0)
        action = np.asarray(baselines.make(look_around, env).predict(observation)[0])
        assert action.shape == shape and np.all(action[..., 1] == Gaze.LEFT)
    named = load("examples.extend_policy:look_around", one)
    for policy in (look_around, named, lambda env: named, partial(Greedy, gaze_criterion="fisher_trace")):
        assert run_episode(one, policy, seed=0).landmarks_mapped[-1] > 0
