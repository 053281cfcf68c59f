"""Training and the learned policies: small, but all the way."""

import base64
import io
import json
import pickle
import shutil
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym
import agents
from activeslam_gym import Gaze, Motion

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO  # noqa: E402

from agents import policies, task  # noqa: E402
from agents.__main__ import main  # noqa: E402
from agents.learn import learner as learners  # noqa: E402
from agents.learn.learner import save_learner, weights_of  # noqa: E402
from agents.learn.recipe import Recipe  # noqa: E402
from agents.learn.weights import SHIPPED, read, read_card, save, shipped  # noqa: E402
from agents.train import CHECKPOINT, Args, train  # noqa: E402

SMALL: dict[str, Any] = {"num_envs": 2, "width": 16, "period": 280, "validation_episodes": 2, "test_episodes": 0}
SMALL |= {"duration": 5.0, "decision_period": 0.25, "warm_start": 0.0}
LEFT = {"policy.npz", "policy.json", CHECKPOINT}


def acts(env: gym.Env, policy: Any) -> np.ndarray:
    """What a policy does at the start of a room, which the environment takes."""
    action, _ = policy.predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)
    return action


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
        assert card["command"].startswith("python -m agents train ")


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
    train(Args(out=trained, total_steps=80, **SMALL))
    assert PPO.load(trained / CHECKPOINT).num_timesteps == 80
    with pytest.raises(ValueError, match="holds a training with reward='entropy', got 'log_score'"):
        train(Args(out=trained, total_steps=80, reward="log_score", **SMALL))


def test_the_same_seed_trains_the_same_weights(tmp_path: Path) -> None:
    for name in "ab":
        train(Args(out=tmp_path / name, total_steps=40, seed=3, **SMALL))
    (a, _), (b, _) = (read(str(tmp_path / name / "policy.npz")) for name in "ab")
    for key in a:
        np.testing.assert_array_equal(a[key], b[key])


def test_a_learned_policy_acts_in_single_batch_discrete_and_larger_environments(trained: Path) -> None:
    env = gym.make("ActiveSLAM-v0")
    action = acts(env, agents.load(str(trained / "policy.npz"), env))
    np.testing.assert_array_equal(acts(env, policies.load(str(trained / "policy.npz"), env)), action)
    envs = gym.make_vec("ActiveSLAM-v0", num_envs=3)
    np.testing.assert_array_equal(acts(envs, agents.load(str(trained / "policy.npz"), envs))[0], action)
    one = gym.make("ActiveSLAMDiscrete-v0")
    assert acts(one, agents.load(str(trained / "policy.npz"), one)) == 3 * action[0] + action[1]
    larger = gym.make("ActiveSLAM-v0", scenario={"landmark_count": 60}, gaze_period=0.25)
    acts(larger, agents.load(str(trained / "policy.npz"), larger))


def test_it_holds_its_action_between_its_decisions(trained: Path) -> None:
    env = gym.make("ActiveSLAM-v0", gaze_period=0.05)
    policy, state, actions = agents.load(str(trained / "policy.npz"), env), None, []
    observation, _ = env.reset(seed=0)
    for _ in range(10):
        action, state = policy.predict(observation, state)
        actions.append(list(action))
        observation = env.step(action)[0]
    assert actions == [actions[0]] * 5 + [actions[5]] * 5


@pytest.mark.parametrize(("scenario", "sensor"), [("paper", "points"), ("gallery-pixels", "corners")])
def test_a_scenario_of_images_is_trained_in_without_images(scenario: str, sensor: str) -> None:
    env = learners.make_training(Recipe(scenario=scenario, num_envs=1))
    assert env.unwrapped.scenario.sensor == sensor
    assert env.unwrapped.scenario.name == scenario


@pytest.mark.parametrize(("algorithm", "scenario"), [("ppo", "paper"), ("a2c", "sprint")])
def test_training_begins_near_the_action_that_the_best_sequence_holds_longest(algorithm: Any, scenario: str) -> None:
    recipe = Recipe(algorithm=algorithm, scenario=scenario, num_envs=2, warm_start=0.7)
    env = learners.make_training(recipe)
    policy = learners.make_learner(recipe, env, None).policy
    drawn = policy.get_distribution(torch.as_tensor(env.reset())).distribution
    longest = {"paper": (Motion.LEFT, Gaze.RIGHT), "sprint": (Motion.RIGHT, Gaze.LEFT)}[scenario]
    for part, held in zip(drawn, longest):
        others = (1.0 - 0.7) / (part.probs.shape[1] - 1)
        expected = np.where(np.arange(part.probs.shape[1]) == held, 0.7, others)
        np.testing.assert_allclose(part.probs.detach().numpy(), np.tile(expected, (2, 1)), atol=0.03)
    env.close()


def test_a_policy_of_one_scenario_acts_in_another_whether_there_are_range_finders_or_not(
    trained: Path, tmp_path: Path
) -> None:
    furnished = gym.make("ActiveSLAM-v0", scenario="office", gaze_period=0.25)
    plain = gym.make("ActiveSLAM-v0")
    acts(furnished, agents.load(str(trained / "policy.npz"), furnished))
    train(Args(out=tmp_path, total_steps=40, scenario="office", **SMALL))
    assert json.loads((tmp_path / "policy.json").read_text())["scenario"] == "office"
    observation = furnished.reset(seed=3)[0]
    far = activeslam_gym.observation_layout(furnished).global_slices["clearance"]
    assert far.stop == activeslam_gym.observation_layout(furnished).tokens.start  # behind all others
    observation[far] = 1.0  # nothing within reach
    here, there = agents.load(str(tmp_path / "policy.npz"), furnished), agents.load(str(tmp_path / "policy.npz"), plain)
    without = np.delete(observation, np.arange(far.start, far.stop))
    np.testing.assert_array_equal(here.predict(observation)[0], there.predict(without)[0])


@pytest.mark.parametrize("algorithm", ["dqn", "a2c", "sac"])
def test_every_algorithm_has_its_actions_and_acts_on_all(tmp_path: Path, algorithm: Any) -> None:
    train(Args(out=tmp_path, algorithm=algorithm, total_steps=40, **SMALL))
    for name in ("ActiveSLAM", "ActiveSLAMDiscrete", "ActiveSLAMContinuous"):
        env = gym.make(f"{name}-v0")
        acts(env, agents.load(str(tmp_path / "policy.npz"), env))
    assert task.run_policy(str(tmp_path / "policy.npz"), task.make_environment({"duration": 1.0}), [3])[0].seed == 3
    points = policies.actions_of(str(tmp_path / "policy.npz")) == "Continuous"
    assert points == (algorithm == "sac") and not policies.actions_of("ppo") and not policies.actions_of("stay")


def test_an_interrupted_training_leaves_weights_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from agents.learn.best_weights import BestWeights

    def interrupt(self: BestWeights) -> bool:
        if self.num_timesteps >= 20:
            raise KeyboardInterrupt
        return True

    with monkeypatch.context() as patched:
        patched.setattr(BestWeights, "_on_step", interrupt)
        assert not train(Args(out=tmp_path, total_steps=80, **SMALL))
    assert {path.name for path in tmp_path.iterdir()} >= LEFT
    assert "interrupted" in json.loads((tmp_path / "policy.json").read_text())["chosen"]
    assert train(Args(out=tmp_path, total_steps=80, **SMALL))
    assert "2 validation episodes" in json.loads((tmp_path / "policy.json").read_text())["chosen"]


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
    shutil.copy(trained / "policy.npz", tmp_path / "bad.npz")
    bad = {
        "algorithm": ("td3", "'td3'; allowed"),
        "width": (None, "width"),
        "decision_period": ("often", "decision_period"),
    }
    for name, (value, said) in bad.items():
        (tmp_path / "bad.json").write_text(json.dumps(card | {name: value}))
        with pytest.raises(ValueError, match=said):
            agents.load(str(tmp_path / "bad.npz"), env)
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


def test_a_recipe_is_arguments_by_name_which_later_ones_replace(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    small = "--scenario=sprint --num-envs=2 --duration=2 --total-steps=8 --validation-episodes=1 --test-episodes=0"
    assert main(["train", "--recipe", "quick", *small.split(), "--out", str(tmp_path)]) == 0
    arguments = json.loads((tmp_path / "arguments.json").read_text(encoding="utf-8"))
    named = {"num_envs": 2, "width": 256, "reward": "log_score", "entropy_bonus": 0.01, "total_steps": 8}
    assert named.items() <= arguments.items()
