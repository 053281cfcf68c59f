"""Several scenarios in one training: their common layout, their batches, and weights that act in all."""

import json
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
from activeslam_gym import Gaze, Motion, config
from activeslam_gym.envs.observation import CONTEXT_FEATURES, CONTEXT_SIZE, layout_of

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer

from agents.learn import learner as learners
from agents.learn.inputs import Inputs, common_size
from agents.learn.learner import weights_of
from agents.learn.policy import SetEncoder, network_of
from agents.learn.recipe import Recipe
from agents.learn.weights import read
from agents.train import Args, train
from studies import imitation

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


def test_an_export_of_several_scenarios_is_trained_in_one(tmp_path: Path) -> None:
    """Its rollout was still grouped by the scenarios of its own training: a traceback, or wrong groups."""
    recipe = Recipe(scenario="sprint+office", **SHORT)
    with closing(learners.make_training(recipe)) as env:
        weights = weights_of(learners.make_learner(recipe, env, None))
    learners.learner_of(weights, asdict(recipe)).save(tmp_path / "several.zip")
    with closing(learners.make_validation(recipe, 3)["sprint"]) as env:
        learner = PPO.load(tmp_path / "several.zip", env=env)
        assert learner.learn(6).num_timesteps == 6 and type(learner.rollout_buffer) is RolloutBuffer


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
