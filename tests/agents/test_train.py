"""Training and the learned policies: small, but all the way."""

import base64
import csv
import io
import json
import pickle
import shutil
from contextlib import closing
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
from activeslam_gym import Gaze, Motion, config
from activeslam_gym.envs.observation import CONTEXT_FEATURES, CONTEXT_SIZE, layout_of

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer

from agents import policies, task
from agents.__main__ import main
from agents.learn import best_weights
from agents.learn import learner as learners
from agents.learn.best_weights import BestWeights
from agents.learn.inputs import Inputs, common_size
from agents.learn.learner import save_learner, weights_of
from agents.learn.policy import SetEncoder, network_of
from agents.learn.recipe import CURVE, Recipe
from agents.learn.weights import SHIPPED, read, read_card, save, shipped
from agents.train import CHECKPOINT, Args, _require_same, train
from examples.extend_range_sensor import RangeSensor
from studies import imitation

SMALL: dict[str, Any] = {"num_envs": 2, "width": 16, "period": 280, "validation_episodes": 2, "test_episodes": 0}
SMALL |= {"duration": 5.0, "decision_period": 0.25, "warm_start": 0.0}
LEFT = {"policy.npz", "policy.json", CHECKPOINT}


def acts(env: gym.Env, weights: Path) -> np.ndarray:
    """What a policy does at the start of a room, which the environment takes."""
    action, _ = agents.load(str(weights), env).predict(env.reset(seed=0)[0])
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
    assert read_card(tmp_path / "policy.npz")["steps"] == 40
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


def test_an_export_of_several_scenarios_is_trained_in_one(tmp_path: Path) -> None:
    """Its rollout was still grouped by the scenarios of its own training: a traceback, or wrong groups."""
    recipe = Recipe(scenario="sprint+office", **SHORT)
    with closing(learners.make_training(recipe)) as env:
        weights = weights_of(learners.make_learner(recipe, env, None))
    learners.learner_of(weights, asdict(recipe)).save(tmp_path / "several.zip")
    with closing(learners.make_validation(recipe, 3)["sprint"]) as env:
        learner = PPO.load(tmp_path / "several.zip", env=env)
        assert learner.learn(6).num_timesteps == 6 and type(learner.rollout_buffer) is RolloutBuffer


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
        acts(gym.wrappers.FrameStackObservation(gym.make("ActiveSLAM-v0"), 2), weights)


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


def test_a_recipe_is_arguments_by_name_which_later_ones_replace(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    small = "--scenario=sprint --num-envs=2 --duration=2 --total-steps=8 --validation-episodes=1 --test-episodes=0"
    assert main(["train", "--recipe", "quick", *small.split(), "--out", str(tmp_path)]) == 0
    arguments = json.loads((tmp_path / "arguments.json").read_text(encoding="utf-8"))
    named = {"num_envs": 2, "width": 256, "reward": "log_score", "entropy_bonus": 0.01, "total_steps": 8}
    assert named.items() <= arguments.items()


SHORT: dict[str, Any] = {"duration": 2.0, "num_envs": 2, "width": 16, "warm_start": 0.0}
STARTS = dict(zip(CONTEXT_FEATURES, np.cumsum([0, *CONTEXT_FEATURES.values()])))


def test_the_context_tells_the_scales_that_the_observation_leaves_out() -> None:
    env = gym.make("ActiveSLAM-v0", scenario="sprint", gaze_period=1.0)
    env.reset(seed=0)
    context, scenario = env.unwrapped.context, config.SCENARIOS["sprint"]
    np.testing.assert_allclose(context[:3], np.array(scenario.room_size) / 20.0, rtol=1e-6)
    assert context[STARTS["duration"]] == pytest.approx(np.log10(10.0) / 2.0)
    assert context[STARTS["noise"]] == pytest.approx(np.log10(scenario.pixel_std))
    assert context[STARTS["command_known"]] == 1.0 and context[STARTS["reach"]] == 1.0
    left = []
    for _ in range(10):
        left.append(env.unwrapped.context[STARTS["time_left"]])
        env.step((Motion.STAY, Gaze.STAY))
    np.testing.assert_allclose(10.0 ** (2.0 * np.array(left)) - 1.0, np.arange(10, 0, -1), rtol=1e-5)


@pytest.mark.parametrize("name", Recipe(scenario="all").scenarios)
def test_every_scenario_has_the_common_layout(name: str) -> None:
    layout = layout_of(config.SCENARIOS[name])
    size = common_size(layout)
    inputs = Inputs(layout, size, 150)
    assert (inputs.layout.tokens.start, inputs.layout.token_shape) == (size, (150, layout.token_shape[1]))
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (2, layout.size)).astype(np.float32)
    context = np.full((2, CONTEXT_SIZE), 0.5, np.float32)
    read = inputs(seen, context)
    assert read.shape == (2, inputs.layout.size)
    np.testing.assert_array_equal(read[:, :32], seen[:, :32])
    finders = seen[:, layout.global_slices["clearance"]] if "clearance" in layout.global_slices else np.ones((2, 7))
    np.testing.assert_array_equal(read[:, 32:39], finders)
    np.testing.assert_array_equal(read[:, 39:size], context)
    tokens = seen[:, layout.tokens]
    np.testing.assert_array_equal(read[:, size : size + tokens.shape[1]], tokens)
    assert not read[:, size + tokens.shape[1] :].any()


def test_the_encoder_leaves_empty_tokens_out() -> None:
    layout = Inputs(layout_of(config.SCENARIOS["paper"]), None, 60).layout
    encoder = SetEncoder(gym.spaces.Box(-1.0, 1.0, (layout.size,)), layout, 8)
    observations = torch.zeros(3, layout.size)
    tokens = torch.rand(3, *layout.token_shape)
    present = torch.zeros(3, layout.token_shape[0], dtype=torch.bool)
    present[0, [1, 5, 59]], present[1, :40] = True, True  # of the last one no token is there
    tokens[:, :, encoder.kinds] = 0.0
    tokens[:, :, encoder.kinds.start][present] = 1.0
    observations[:, layout.tokens] = tokens.flatten(1)
    with torch.no_grad():
        pooled = encoder(observations)[:, 8:]
        for row in range(2):
            encoded = encoder.tokens(tokens[row, present[row]])
            torch.testing.assert_close(pooled[row], torch.cat([encoded.mean(dim=0), encoded.amax(dim=0)]))
    assert not pooled[2].any()


def test_a_batch_of_scenarios_plays_what_each_plays_alone() -> None:
    together = learners.make_training(Recipe(scenario="sprint+office", **SHORT))
    alone = [learners.make_training(Recipe(scenario=name, **SHORT)) for name in ("sprint", "office")]
    tokens, own = together.layout.tokens, [one.reset() for one in alone]
    seen = together.reset()
    rng = np.random.default_rng(0)
    for _ in range(3):  # beyond the end of the episodes
        for rows, one, observation in zip((slice(0, 2), slice(2, 4)), alone, own):
            part = observation[:, layout_of(one.unwrapped.scenario).tokens]
            np.testing.assert_array_equal(seen[rows, tokens.start : tokens.start + part.shape[1]], part)
        actions = np.stack([rng.integers(7, size=4), rng.integers(3, size=4)], axis=1)
        steps = [one.step(part) for one, part in zip(alone, (actions[:2], actions[2:]))]
        own = [step[0] for step in steps]
        seen, rewards, dones, infos = together.step(actions)
        ends = [info["terminal_observation"] for info in infos if "terminal_observation" in info]
        assert len(ends) == dones.sum() and all(end.shape == seen[0].shape for end in ends)
        np.testing.assert_array_equal(dones, np.concatenate([step[2] for step in steps]))
        assert [info.get("episode", {}).get("r") for info in infos] == [
            info.get("episode", {}).get("r") for step in steps for info in step[3]
        ]
        dimensions = np.repeat([learners.dimensions(name) for name in ("sprint", "office")], 2)
        per_dimension = np.concatenate([step[1] for step in steps]) * learners.dimensions("paper") / dimensions
        np.testing.assert_allclose(rewards, per_dimension, rtol=1e-6)
    with pytest.raises(ValueError, match="indices must be None"):
        together.set_attr("render_mode", None, indices=[0])
    for one in (together, *alone):
        one.close()


def test_each_scenario_has_its_own_unit_of_advantage() -> None:
    """Rare losses in one scenario leave the decisions of the others as loud as they were."""
    space = gym.spaces.Box(-1.0, 1.0, (1,))
    buffer = learners.RolloutOfScenarios(5, space, gym.spaces.MultiDiscrete([7, 3]), "cpu", n_envs=4, scenarios=2)
    rng = np.random.default_rng(0)
    for _ in range(5):
        rewards = np.concatenate([rng.normal(0.5, 1.0, 2), rng.normal(-3.0, 100.0, 2)])
        buffer.add(np.zeros((4, 1)), np.zeros((4, 2)), rewards, np.zeros(4), torch.zeros(4), torch.zeros(4))
    buffer.compute_returns_and_advantage(torch.zeros(4), np.zeros(4))
    for part in (buffer.advantages[:, :2], buffer.advantages[:, 2:]):
        assert part.mean() == pytest.approx(0.0, abs=1e-5) and part.std() == pytest.approx(1.0, abs=1e-5)
    assert buffer.returns[:, 2:].std() > 50.0  # what the critic learns keeps its unit


def test_weights_of_several_scenarios_act_everywhere(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    small = SHORT | {"period": 8, "validation_episodes": 1, "test_episodes": 1}
    train(Args(out=tmp_path, scenario="sprint+office", total_steps=8, **small))
    results = json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))["results"]
    assert results.keys() == {"sprint", "office"} and results["office"]["lost"]["episodes"] == 1
    for name in ("paper", "office", "mixed", "hand-held"):
        single = gym.make("ActiveSLAM-v0", scenario=name, gaze_period=1.0)
        batch = gym.make_vec("ActiveSLAM-v0", num_envs=2, scenario=name, gaze_period=1.0)
        action = agents.load(str(tmp_path / "policy.npz"), single).predict(single.reset(seed=3)[0])[0]
        actions = agents.load(str(tmp_path / "policy.npz"), batch).predict(batch.reset(seed=3)[0])[0]
        np.testing.assert_array_equal(actions[0], action)


def test_training_goes_on_from_weights_of_several_scenarios(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    small = {"period": 8, "validation_episodes": 2, "test_episodes": 0}
    args = Args(
        out=tmp_path, scenario="sprint", initial="generalist", learning_rate=1e-12, total_steps=8, **(SHORT | small)
    )
    for wrong, said in (
        (replace(args, initial="ppo"), "initial: 'ppo' is of ppo in paper"),
        (replace(args, algorithm="dqn"), "allowed: ppo or a2c"),
    ):
        with pytest.raises(ValueError, match=said):
            train(wrong)
    assert train(args)
    own, shipped = (read(name)[0] for name in (str(tmp_path / "policy.npz"), "generalist"))
    for name, values in shipped.items():
        np.testing.assert_allclose(own[name], values, atol=1e-6)
    curve = (tmp_path / "curve.csv").read_text(encoding="utf-8").splitlines()
    assert curve[0].startswith("decisions,") and {line.split(",")[2] for line in curve[1:]} == {"sprint"}


def test_a_student_learns_to_decide_as_its_teacher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imitation, "LAST_UPDATES", 100)
    args = imitation.Args(scenario="office+pixels", total_steps=320, num_envs=16, actors=("generalist",), out=tmp_path)
    with pytest.raises(ValueError, match="critics: 'ppo' is of ppo; allowed: dqn"):
        imitation.main(replace(args, critics=("ppo",)))
    imitation.main(args)
    weights, card = read(str(tmp_path / "policy.npz"))
    env = learners.make_training(Recipe.of(card))
    scenarios = [one.unwrapped.scenario for one in env.batches]
    assert [(one.name, one.sensor) for one in scenarios] == [("office", "points"), ("pixels", "corners")]
    inputs, teacher = torch.as_tensor(env.reset())[:16], imitation.Teacher(env.layout, args.actors, args.critics)
    student, (actor,) = network_of(env.layout, weights, card), teacher.networks["actors"]
    for own, wanted in zip(imitation.logits(student, inputs), teacher(inputs, "office")):
        assert (own.argmax(dim=1) == wanted.argmax(dim=1)).float().mean() > 0.8
    for own, wanted in zip(imitation.logits(actor, inputs), teacher(inputs, "hall")):  # where advantages count 0
        torch.testing.assert_close(torch.softmax(imitation.SHARPNESS * own, dim=1), wanted)
