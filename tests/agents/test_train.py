"""Training and the learned policies: small, but all the way."""

import base64
import csv
import io
import json
import pickle
import shlex
import shutil
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import ZipFile

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym
import agents
from activeslam_gym import config

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import tyro
from stable_baselines3 import PPO

from agents import policies, task
from agents.__main__ import main
from agents.learn import best_weights
from agents.learn.best_weights import BestWeights
from agents.learn.learner import save_learner, weights_of
from agents.learn.recipe import CURVE, Recipe
from agents.learn.weights import SHIPPED, card_of, read, read_card, save, shipped
from agents.train import CHECKPOINT, Args, _require_same, train
from examples.extend_range_sensor import RangeSensor

SMALL: dict[str, Any] = {"num_envs": 2, "width": 16, "period": 280, "validation_episodes": 2, "test_episodes": 0}
SMALL |= {"duration": 5.0, "decision_period": 0.25, "warm_start": 0.0}
LEFT = {"policy.npz", "policy.json", CHECKPOINT}


def acts(env: gym.Env, weights: Path) -> np.ndarray:
    """What a policy does at the start of a room, which the environment takes."""
    action, _ = agents.load(str(weights), env).predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)
    return action


def test_a_policy_without_torch_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """It said: No module named 'torch'."""
    monkeypatch.delitem(sys.modules, "agents.learn.policy", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match=r"policy 'ppo' needs torch: .*\[agents\]"):
        agents.load("ppo", gym.make("ActiveSLAM-v0"))


def test_weights_are_exported_for_stable_baselines(tmp_path: Path, capsys: Any) -> None:
    assert main(["export", "--policy", "ppo", "--out", str(tmp_path / "deep" / "ppo.zip")]) == 0
    assert "gaze_period=1" in capsys.readouterr().out
    learner, env = PPO.load(tmp_path / "deep" / "ppo.zip"), gym.make("ActiveSLAM-v0")
    policy, observation = agents.load("ppo", env), env.reset(seed=5)[0]
    for _ in range(20):
        action, _ = policy.predict(observation)
        np.testing.assert_array_equal(action, learner.predict(observation, deterministic=True)[0])
        observation = env.step(env.action_space.sample())[0]
    learner.set_env(env)
    assert learner.gamma == read_card(SHIPPED / "ppo.npz")["gamma"]


def test_shipped_weights_are_of_this_behaviour_or_measured_beside_a_new_training_or_say_that_they_are_stale() -> None:
    """Old weights stay where those of a new run are no better in the rooms for validation: docs/policies.md."""
    for name in shipped():
        card = read_card(SHIPPED / f"{name}.npz")
        current = card.get("measured_behaviour", card["behaviour"]) == activeslam_gym.BEHAVIOUR
        assert current or card.get("stale"), f"{name}: mark it stale, or retrain it: {card['command']}"
        assert card["command"].startswith(("python -m agents train ", "python -m studies.imitation "))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with weights after one rollout."""
    out = tmp_path_factory.mktemp("train")
    pytest.importorskip("tensorboard")
    train(Args(out=out, total_steps=40, **(SMALL | {"test_episodes": 2})))
    return out


def test_training_leaves_weights_card_and_checkpoint_and_goes_on(trained: Path) -> None:
    assert {path.name for path in trained.iterdir()} >= LEFT
    card = json.loads((trained / "policy.json").read_text())
    assert card["results"]["episodes"] == 2 and card["steps_trained"] == 40
    assert set(card["results"]["references"]) == {"best-constant", "mi-constant", "mi-fisher"}
    assert card["held_out_return"] is not None  # the end of a short training is judged too
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator").EventAccumulator
    events = accumulator(str(next((trained / "logs").iterdir()))).Reload()
    assert events.Scalars("eval/mean_reward")[-1].value == events.Scalars("eval/paper/mean_reward")[-1].value
    assert events.Scalars("eval/score")[-1].value == pytest.approx(card["held_out_return"])
    train(Args(out=trained, total_steps=80, **SMALL))
    assert PPO.load(trained / CHECKPOINT).num_timesteps == 80
    with pytest.raises(ValueError, match="holds a training with reward='entropy', got 'log_score'"):
        train(Args(out=trained, total_steps=80, reward="log_score", **SMALL))
    with pytest.raises(ValueError, match="holds a training with validation_episodes=2, got 3"):
        train(Args(out=trained, total_steps=80, **(SMALL | {"validation_episodes": 3})))


def test_the_command_on_a_card_has_all_that_determines_the_weights(trained: Path) -> None:
    """It lacked the period and the number of validation episodes, and gave other weights."""
    card = read_card(trained / "policy.npz")
    args = tyro.cli(Args, args=[*card["command"].split()[4:], "--out", str(trained)])
    assert args.arguments() == Args(**{**SMALL, "total_steps": args.total_steps}).arguments()
    assert Recipe.of(card) == Recipe(**args.arguments())
    own = Recipe(scenario='{"pixel_std": 4.0}', initial="my weights/policy.npz", learning_rate=1.23456789e-4, seed=7)
    command = card_of(asdict(own), 0, 0.0, True)["command"]  # it could not be pasted
    assert Recipe(**tyro.cli(Args, args=shlex.split(command)[4:]).arguments()) == own
    written = trained / "arguments.json"
    older = {name: value for name, value in json.loads(written.read_text()).items() if name != "period"}
    written.write_text(json.dumps(older))
    _require_same(args)
    with pytest.raises(ValueError, match="holds a training with epochs=8, got 9"):
        _require_same(replace(args, epochs=9))


def test_weights_are_judged_after_each_update_and_the_last_ones_always(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were judged in the last step of a rollout, before its update, so that the last ones could be left out."""
    judged, visit = list[tuple[int, int]](), BestWeights._visit

    def note(self: BestWeights) -> None:
        judged.append((self.num_timesteps, self.learner._n_updates))
        visit(self)

    monkeypatch.setattr(BestWeights, "_visit", note)
    train(Args(out=tmp_path, total_steps=80, **(SMALL | {"period": 10, "target_kl": 1e9})))
    assert judged == [(40, 8), (80, 16)]
    with (tmp_path / CURVE).open() as file:
        rows = list(csv.DictReader(file))
    assert [row["decisions"] for row in rows] == ["40", "80"]
    assert all(float(row["policy_entropy"]) > 0.0 for row in rows)  # those of an update that was over were missing


def test_an_interrupted_rollout_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C within a rollout took its decisions from the training, which learned nothing from them."""
    args, at = Args(out=tmp_path, total_steps=80, **(SMALL | {"target_kl": 1e9})), 60

    def interrupt(self: BestWeights) -> bool:
        if self.num_timesteps == at:
            raise KeyboardInterrupt
        return True

    with monkeypatch.context() as patched:
        patched.setattr(BestWeights, "_on_step", interrupt)
        assert not train(args)
    learner = PPO.load(tmp_path / CHECKPOINT)
    assert (learner.num_timesteps, learner._n_updates) == (40, 8)
    card = read_card(tmp_path / "policy.npz")
    assert card["steps"] == card["steps_trained"] == 40 and card["seconds_trained"] >= card["seconds"]
    assert train(args)
    learner = PPO.load(tmp_path / CHECKPOINT)
    assert (learner.num_timesteps, learner._n_updates) == (80, 16)


def test_a_scenario_with_parts_of_ones_own_is_trained_and_tested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The card of a finished training failed: objects of the scenario are no JSON."""
    monkeypatch.setattr(best_weights, "REFERENCES", ("stay",))
    monkeypatch.setitem(config.SCENARIOS, "own", config.Scenario(name="own", sensor=RangeSensor))
    small = SMALL | {"duration": 1.0, "total_steps": 8, "validation_episodes": 1, "test_episodes": 1}
    for folder, name in (("a", "own"), ("b", "examples.extend_range_sensor:own")):
        assert train(Args(out=tmp_path / folder, scenario=name, **small))
        assert set(read_card(tmp_path / folder / "policy.npz")["results"]["references"]) == {"stay"}
    nameless = config.Scenario(name="nameless", sensor=partial(RangeSensor))
    monkeypatch.setitem(config.SCENARIOS, "nameless", nameless)
    with pytest.raises(ValueError, match="sensor"):
        train(Args(out=tmp_path / "nameless", scenario="nameless", **small))
    assert not (tmp_path / "nameless").exists()


def test_the_same_seed_trains_the_same_weights(tmp_path: Path) -> None:
    for name in "ab":
        train(Args(out=tmp_path / name, total_steps=40, seed=3, **SMALL))
    (a, _), (b, _) = (read(str(tmp_path / name / "policy.npz")) for name in "ab")
    for key in a:
        np.testing.assert_array_equal(a[key], b[key])


def test_a_learned_policy_acts_in_single_batch_discrete_and_larger_environments(trained: Path) -> None:
    weights = trained / "policy.npz"
    action = acts(gym.make("ActiveSLAM-v0"), weights)
    np.testing.assert_array_equal(acts(gym.make_vec("ActiveSLAM-v0", num_envs=3), weights)[0], action)
    assert acts(gym.make("ActiveSLAMDiscrete-v0"), weights) == 3 * action[0] + action[1]
    for scenario in ({"landmark_count": 60}, "office"):
        acts(gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25), weights)
    with pytest.raises(ValueError, match="observation: of shape"):
        agents.load(str(weights), gym.make("ActiveSLAM-v0")).predict(np.zeros(3))
    for wrap in (lambda env: gym.wrappers.FrameStackObservation(env, 2), gym.wrappers.NormalizeObservation):
        with pytest.raises(ValueError, match="a wrapper changes its observations"):
            acts(wrap(gym.make("ActiveSLAM-v0")), weights)


def test_it_holds_its_action_between_its_decisions(trained: Path) -> None:
    env = gym.make("ActiveSLAM-v0", gaze_period=0.05)
    policy, state, actions = agents.load(str(trained / "policy.npz"), env), None, []
    observation, _ = env.reset(seed=0)
    for _ in range(10):
        action, state = policy.predict(observation, state)
        actions.append(list(action))
        observation = env.step(action)[0]
    assert actions == [actions[0]] * 5 + [actions[5]] * 5


@pytest.mark.parametrize("algorithm", ["dqn", "a2c", "sac"])
def test_every_algorithm_has_its_actions_and_acts_on_all(tmp_path: Path, algorithm: Any) -> None:
    train(Args(out=tmp_path, algorithm=algorithm, total_steps=40, **SMALL))
    for name in ("ActiveSLAM", "ActiveSLAMDiscrete", "ActiveSLAMContinuous"):
        acts(gym.make(f"{name}-v0"), tmp_path / "policy.npz")
    assert task.run_policy(str(tmp_path / "policy.npz"), task.make_environment({"duration": 1.0}), [3])[0].seed == 3
    points = policies.actions_of(str(tmp_path / "policy.npz")) == "Continuous"
    assert points == (algorithm == "sac") and not policies.actions_of("ppo") and not policies.actions_of("stay")


def test_an_interrupted_training_leaves_weights_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(self: BestWeights) -> bool:
        if self.num_timesteps >= 20:
            raise KeyboardInterrupt
        return True

    with monkeypatch.context() as patched:
        patched.setattr(BestWeights, "_on_step", interrupt)
        assert not train(Args(out=tmp_path, total_steps=80, **SMALL))
    assert {path.name for path in tmp_path.iterdir()} >= LEFT
    assert "interrupted" in json.loads((tmp_path / "policy.json").read_text())["chosen"]
    with monkeypatch.context() as patched:
        patched.setattr(BestWeights, "_validation", lambda *_: interrupt(SimpleNamespace(num_timesteps=80)))
        assert not train(Args(out=tmp_path, total_steps=80, **SMALL))
    assert train(Args(out=tmp_path, total_steps=80, **SMALL))
    card = json.loads((tmp_path / "policy.json").read_text())
    assert "2 validation episodes" in card["chosen"] and card["seconds_trained"] > 0.0


class Evil:
    """Writes a file where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (self.path, "w")


def test_a_foreign_checkpoint_runs_no_code(trained: Path, tmp_path: Path) -> None:
    folder, hit = tmp_path / "foreign", tmp_path / "hit"
    shutil.copytree(trained, folder)
    with ZipFile(folder / CHECKPOINT) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    held = json.loads(members["data"])
    held["policy_class"] = {":type:": "type", ":serialized:": base64.b64encode(pickle.dumps(Evil(hit))).decode()}
    tensors = io.BytesIO()
    torch.save(Evil(hit), tensors)

    def put(**changed: bytes) -> None:
        with ZipFile(folder / CHECKPOINT, "w") as archive:
            for name, value in (members | changed).items():
                archive.writestr(name, value)

    steps = held["num_timesteps"]
    put(data=json.dumps(held).encode())
    train(Args(out=folder, total_steps=steps + 40, **SMALL))  # the pickle beside the numbers is not looked at
    put(**{"policy.pth": tensors.getvalue()})
    with pytest.raises(ValueError, match="holds more than tensors and numbers, which could run code"):
        train(Args(out=folder, total_steps=steps + 80, **SMALL))
    assert not hit.exists()


def test_weights_that_are_no_numbers_are_neither_kept_nor_used(trained: Path, tmp_path: Path) -> None:
    env, card, diverged = gym.make("ActiveSLAM-v0"), read_card(trained / "policy.npz"), "diverged"
    learner = PPO.load(trained / CHECKPOINT)
    with torch.no_grad():
        next(learner.policy.parameters())[:] = np.nan
    with pytest.raises(ValueError, match=diverged):
        save(tmp_path / "new.npz", weights_of(learner), card)
    with pytest.raises(ValueError, match=diverged):
        save_learner(learner, tmp_path / "new.zip")
    assert not list(tmp_path.glob("new*"))
    np.savez(tmp_path / "bad.npz", **{name: value.numpy() for name, value in learner.policy.state_dict().items()})
    with pytest.raises(ValueError, match=diverged):
        agents.load(str(tmp_path / "bad.npz"), env)


def test_a_card_beside_weights_cannot_change_how_they_play(tmp_path: Path) -> None:
    """`compare --resume` knows weights by their file, and gave a changed `decision_period` the old results."""
    for name in shipped():
        path, card = tmp_path / f"{name}.npz", read_card(SHIPPED / f"{name}.npz")
        shutil.copy(SHIPPED / path.name, path)
        path.with_suffix(".json").write_text(json.dumps(card | {"decision_period": 2.0}))
        with pytest.raises(ValueError, match="of other weights"):
            read(str(path))
        np.savez(path, **read(name)[0])  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="holds no card"):
            read(str(path))


def test_a_recipe_is_arguments_by_name_which_later_ones_replace(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    small = "--scenario=sprint --num-envs=2 --duration=2 --total-steps=8 --validation-episodes=1 --test-episodes=0"
    assert main(["train", "--recipe", "quick", *small.split(), "--out", str(tmp_path)]) == 0
    arguments = json.loads((tmp_path / "arguments.json").read_text(encoding="utf-8"))
    named = {"num_envs": 2, "width": 256, "reward": "log_score", "entropy_bonus": 0.01, "total_steps": 8}
    assert named.items() <= arguments.items()
