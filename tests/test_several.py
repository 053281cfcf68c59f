"""One policy for several scenarios: context, common layout, batch of batches, imitation."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym import Gaze, Motion, config
from activeslam_gym.envs.context import CONTEXT_FEATURES, CONTEXT_SIZE
from activeslam_gym.envs.observation import layout_of

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import agents  # noqa: E402
from agents.learn import algorithms, imitation  # noqa: E402
from agents.learn.encoder import SetEncoder  # noqa: E402
from agents.learn.inputs import Inputs, common_size  # noqa: E402
from agents.learn.recipe import Recipe  # noqa: E402
from agents.train import Args, train  # noqa: E402

returns = imitation._with_returns
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
    together = algorithms.make_training(Recipe(scenario="sprint+office", **SHORT))
    alone = [algorithms.make_training(Recipe(scenario=name, **SHORT)) for name in ("sprint", "office")]
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
        dimensions = np.repeat([algorithms.dimensions(name) for name in ("sprint", "office")], 2)
        per_dimension = np.concatenate([step[1] for step in steps]) * algorithms.dimensions("paper") / dimensions
        np.testing.assert_allclose(rewards, per_dimension, rtol=1e-6)
    with pytest.raises(ValueError, match="indices must be None"):
        together.set_attr("render_mode", None, indices=[0])
    for one in (together, *alone):
        one.close()


def test_each_scenario_has_its_own_unit_of_advantage() -> None:
    """Rare losses in one scenario leave the decisions of the others as loud as they were."""
    space = gym.spaces.Box(-1.0, 1.0, (1,))
    buffer = algorithms.RolloutOfScenarios(5, space, gym.spaces.MultiDiscrete([7, 3]), "cpu", n_envs=4, scenarios=2)
    rng = np.random.default_rng(0)
    for _ in range(5):
        rewards = np.concatenate([rng.normal(0.5, 1.0, 2), rng.normal(-3.0, 100.0, 2)])
        buffer.add(np.zeros((4, 1)), np.zeros((4, 2)), rewards, np.zeros(4), torch.zeros(4), torch.zeros(4))
    buffer.compute_returns_and_advantage(torch.zeros(4), np.zeros(4))
    for part in (buffer.advantages[:, :2], buffer.advantages[:, 2:]):
        assert part.mean() == pytest.approx(0.0, abs=1e-5) and part.std() == pytest.approx(1.0, abs=1e-5)
    assert buffer.returns[:, 2:].std() > 50.0  # what the critic learns keeps its unit


def test_imitation_learns_what_the_teacher_does_and_what_it_returns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imitation, "LAST_UPDATES", 200)
    recipe = Recipe(scenario="sprint", teachers=("sprint=orbit",), imitated_steps=64, **(SHORT | {"num_envs": 8}))
    env = algorithms.make_training(recipe)
    learner = algorithms.make_learner(recipe, env, None)
    before, seen = learner.policy.predict_values(torch.as_tensor(env.reset())), []
    monkeypatch.setattr(imitation, "_with_returns", lambda *given: seen.append(returns(*given)) or seen[-1])
    lines = list(imitation.imitate(learner, recipe, env))
    assert len(lines) == 4 and lines[-1].startswith("64 imitated decisions")
    observations = torch.as_tensor(env.reset())  # of rooms that were not among them
    motion, gaze = learner.policy.get_distribution(observations).distribution
    assert motion.probs[:, Motion.RIGHT].mean() > 0.9 and gaze.probs[:, Gaze.LEFT].mean() > 0.9
    first = np.concatenate([one[3][:8] for one in seen]).mean()  # return from the start of an episode
    values = learner.policy.predict_values(observations)
    assert abs(values.mean().item() - first) < abs(before.mean().item() - first)
    env.close()


def test_weights_of_several_scenarios_act_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imitation, "LAST_UPDATES", 2)
    pytest.importorskip("tensorboard")
    small = SHORT | {"period": 8, "validation_episodes": 1, "test_episodes": 1}
    teachers = ("sprint=stay", "office=stay")
    train(Args(out=tmp_path, scenario="sprint+office", teachers=teachers, imitated_steps=8, total_steps=8, **small))
    results = json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))["results"]
    assert results.keys() == {"sprint", "office"} and results["office"]["lost"]["rooms"] == 1
    for name in ("paper", "office", "mixed", "hand-held"):
        single = gym.make("ActiveSLAM-v0", scenario=name, gaze_period=1.0)
        batch = gym.make_vec("ActiveSLAM-v0", num_envs=2, scenario=name, gaze_period=1.0)
        action = agents.load("policy", single, tmp_path).predict(single.reset(seed=3)[0])[0]
        actions = agents.load(str(tmp_path / "policy.npz"), batch).predict(batch.reset(seed=3)[0])[0]
        np.testing.assert_array_equal(actions[0], action)


def test_imitation_alone_is_judged_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imitation, "LAST_UPDATES", 2)
    pytest.importorskip("tensorboard")
    given = SHORT | {"validation_episodes": 2, "test_episodes": 0, "teachers": ("sprint=stay",), "imitated_steps": 8}
    args = Args(out=tmp_path, scenario="sprint", total_steps=0, **given)
    with pytest.raises(ValueError, match="device: 'abacus'; allowed on this machine: cpu"):
        train(replace(args, device="abacus"))
    assert train(args)
    card = json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))
    assert card["steps"] == 0 and np.isfinite(card["held_out_return"]) and "in 2 validation episodes" in card["chosen"]
    before = (tmp_path / "policy.npz").read_bytes()
    monkeypatch.setattr(imitation, "imitate", lambda *_: pytest.fail("it is imitated already"))
    assert train(args) and (tmp_path / "policy.npz").read_bytes() == before


@pytest.mark.parametrize(
    "given, message",
    [
        ({"scenario": "sprint", "total_steps": 0}, "total_steps: 0"),
        ({"scenario": "sprint+nowhere"}, "nowhere"),
        ({"scenario": "sprint+office", "teachers": ("sprint=stay",)}, "scenario=policy for each of sprint, office"),
        ({"scenario": "sprint", "teachers": ("stay",)}, "teachers: 'stay' for ppo"),
        ({"scenario": "sprint", "teachers": ("sprint=stay",), "algorithm": "dqn"}, "allowed: ppo or a2c"),
    ],
)
def test_bad_recipes_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Recipe(**given).check()
