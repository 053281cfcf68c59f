"""Policies: known best actions in a toy environment whose scores are given, and how open loops are chosen."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym  # noqa: F401  (registers the environments)
import baselines
from activeslam_gym import SCENARIOS, Gaze, Motion, Scenario
from activeslam_gym.evaluation import run_episode
from activeslam_gym.information.candidates import held_plans
from agents.task import make_environment
from baselines import __main__ as table
from baselines import constants, readings, sequences
from baselines.constants import CONSTANTS, best_constant, choose, key_of
from baselines.fixed import Planned
from baselines.policy import TIE, best
from baselines.sequences import Sequence, choose_sequence, constant, log_scores, sequence_from
from examples.extend_scene import SphereScene

OBSERVATION = np.zeros(4, dtype=np.float32)
STEPS = 5


class ScoredEnv:
    """Scores by criterion, and a clock; `calls` has what was scored. `leading` is (B,) for a batch."""

    def __init__(self, leading: tuple[int, ...] = (), amortised: bool = False, steps_per_motion: int = STEPS) -> None:
        self.unwrapped = self
        self.action_space: gym.Space = gym.spaces.MultiDiscrete([7, 3])
        self.scenario = SimpleNamespace(
            motion_criterion="mutual_information", amortised_decision=amortised, frame_time=0.05
        )
        self.steps_per_motion, self.motion_period = steps_per_motion, 1.0
        if leading:
            (self.num_envs,), self.single_action_space = leading, self.action_space
        criteria = ("mutual_information", "fisher_trace")
        self.motion, self.gaze = ({name: np.zeros((*leading, n)) for name in criteria} for n in (7, 3))
        self.joint, self.step_index = np.zeros((*leading, 7, 3)), np.zeros(leading, dtype=int)
        self.gaze_scores, self.joint_scores = self.gaze.__getitem__, lambda criterion: self.joint
        self.lookahead_scores = lambda horizon: self.motion_scores("mutual_information")
        self.calls: list[Any] = []

    motion_phase = property(lambda self: self.step_index % self.steps_per_motion)
    time = property(lambda self: self.step_index * (self.motion_period / self.steps_per_motion))

    def motion_scores(self, criterion: str) -> np.ndarray:
        self.calls.append("all")
        return self.motion[criterion]

    def scores(self, plans: np.ndarray, criterion: str) -> np.ndarray:
        motions = plans["motion"][:, 0]
        self.calls.extend(motions)
        return self.motion[criterion][..., motions]


def act(policy: Any, observation: np.ndarray = OBSERVATION) -> Any:
    return policy.predict(observation)[0]


def test_ties_go_to_stay() -> None:
    assert best(np.zeros(7)) == Motion.STAY
    assert best([1.0, 0, 0, 0, 0, 0, 1.0 - 1e-10]) == Motion.STAY
    assert best([1.0, 0, 0, 0, 0, 0, 1.0 - 1e-8]) == Motion.FORWARD
    assert best(np.array([[0.0, 2.0, 1.0], [3.0, 3.0, 3.0]])).tolist() == [Gaze.LEFT, Gaze.STAY]


BEST = {
    "stay": (Motion.STAY, Gaze.STAY),
    "sweep": (Motion.RIGHT, Gaze.LEFT),
    "orbit": (Motion.RIGHT, Gaze.LEFT),
    "fisher-fisher": (Motion.FORWARD, Gaze.LEFT),
    "joint-mi": (Motion.DOWN, Gaze.RIGHT),
    **dict.fromkeys(("mi-constant", "mi-fisher"), (Motion.UP, Gaze.LEFT)),
    **dict.fromkeys(("mi-mi", "lookahead-2"), (Motion.UP, Gaze.RIGHT)),
}


@pytest.mark.parametrize("name", BEST)
@pytest.mark.parametrize("leading", [(), (2,)])
def test_takes_the_best_action(name: str, leading: tuple[int, ...]) -> None:
    env = ScoredEnv(leading)
    env.motion["mutual_information"][..., Motion.UP] = env.motion["fisher_trace"][..., Motion.FORWARD] = 1.0
    env.gaze["mutual_information"][..., Gaze.RIGHT] = env.gaze["fisher_trace"][..., Gaze.LEFT] = 1.0
    env.joint[..., Motion.DOWN, Gaze.RIGHT] = 1.0
    action = act(baselines.make(name, env), np.zeros((*leading, 4)))
    np.testing.assert_array_equal(action, np.broadcast_to(BEST[name], (*leading, 2)))


def test_a_wrapper_may_change_the_observation_but_not_the_actions() -> None:
    env: Any = gym.wrappers.FrameStackObservation(gym.make("ActiveSLAM-v0"), 3)
    assert act(baselines.make("mi-mi", env), env.reset(seed=0)[0]) in env.action_space
    clipped = gym.wrappers.ClipAction(gym.make("ActiveSLAMContinuous-v0"))
    assert act(baselines.make("orbit", clipped), clipped.reset(seed=0)[0]) in clipped.unwrapped.action_space
    for space in (gym.spaces.Discrete(7), gym.spaces.MultiDiscrete([4, 3]), gym.spaces.Box(-2, 2, (4,), np.float32)):
        with pytest.raises(ValueError, match="its actions are"):
            baselines.make("mi-mi", gym.wrappers.TransformAction(env, lambda action: action, space))


def test_the_readings_of_scenarios_are_those_chosen_on_training_episodes() -> None:
    table = json.loads(readings.TABLE.read_text(encoding="utf-8"))
    assert len(table) >= 10
    for entry in table.values():
        for field, medians in entry["medians"].items():
            lost = entry["lost"].get(field, dict.fromkeys(medians, 0))
            fewest = max(min(lost.values()), readings.MOST_LOST)
            highest = max(median for one, median in medians.items() if lost[one] <= fewest)
            chosen = f"{getattr(SCENARIOS[entry['scenario']], field):g}"
            assert lost[chosen] <= fewest and medians[chosen] > 0.99 * highest


@pytest.mark.parametrize("num_envs", [None, 2])
def test_held_information_plays_the_best_held_action(num_envs: int | None) -> None:
    """Of 21 actions, held to the horizon or the end, those on which the camera stays localised, if there are any.

    The gaze is held for the motion period, as it was planned.
    """
    kwargs = {"gaze_period": 0.25, "duration": 6.0}
    env: Any = (
        gym.make("ActiveSLAM-v0", **kwargs) if num_envs is None else gym.make_vec("ActiveSLAM-v0", num_envs, **kwargs)
    )
    core = env.unwrapped
    policy, observation = baselines.make("greedy-plus", env), env.reset(seed=4)[0]
    for _ in range(9):
        scores, position_std = map(np.atleast_2d, core.forecast(held_plans(20, 16)))
        np.testing.assert_array_equal(scores, np.atleast_2d(core.scores(held_plans(20, 16), "net_information")))
        scores = np.where(position_std <= core.scenario.plan_position_std, scores, -np.inf)
        begins = np.atleast_1d(core.motion_phase)[0] == 0
        action = policy.predict(observation)[0]
        if begins:
            chosen = np.stack((scores.argmax(axis=-1) % 7, scores.argmax(axis=-1) // 7), axis=-1)
        np.testing.assert_array_equal(np.atleast_2d(action), chosen)
        observation = env.step(action)[0]


def test_held_information_takes_the_least_uncertain_plan_where_none_is_safe() -> None:
    env: Any = gym.make("ActiveSLAM-v0", scenario={"plan_position_std": 1e-6}, duration=6.0)
    policy, observation = baselines.make("greedy-plus", env), env.reset(seed=4)[0]
    position_std = env.unwrapped.forecast(held_plans(20, 6)).position_std
    motion, gaze = policy.predict(observation)[0]
    assert position_std[7 * gaze + motion] <= position_std.min() + TIE and np.ptp(position_std) > 0.01


def test_motion_is_chosen_once_a_period_and_held_in_each_environment_of_a_batch() -> None:
    env = ScoredEnv((2,))
    policy, actions = baselines.make("mi-mi", env), []
    env.motion["mutual_information"][:, Motion.UP] = 1.0
    for step in range(STEPS):
        env.step_index = np.array([step, step + 2 * (step > 0)])
        actions.append(act(policy, np.zeros((2, 4)))[:, 0].tolist())
        env.motion["mutual_information"][:, Motion.DOWN] = 2.0
    assert actions == [[Motion.UP, Motion.UP]] * 3 + [[Motion.UP, Motion.DOWN]] * 2
    assert env.calls == ["all"] * 2


def test_sweep_strafes_in_turn_and_random_uses_every_action() -> None:
    def actions(name: str, periods: int, **seed: int) -> list[tuple[int, int]]:
        env = ScoredEnv()
        policy, made = baselines.make(name, env, **seed), []
        for period in range(periods):
            env.step_index = np.array(period * STEPS)
            made.append(tuple(act(policy).tolist()))
        return made

    assert [motion for motion, _ in actions("sweep", 4)] == [Motion.RIGHT, Motion.LEFT] * 2
    drawn = actions("random", 300, seed=3)
    assert drawn == actions("random", 300, seed=3) != actions("random", 300, seed=4) and len(set(drawn)) == 21


@pytest.mark.parametrize("steps", [1, 5, 15])
def test_amortised_decision_scores_every_motion_once_a_period(steps: int) -> None:
    env = ScoredEnv(amortised=True, steps_per_motion=steps)
    policy = baselines.make("mi-mi", env)
    env.motion["mutual_information"][Motion.UP] = 1.0
    assert act(policy)[0] == Motion.UP
    assert env.calls == ["all"]
    for step in range(1, steps):
        env.step_index, before = np.array(step), len(env.calls)
        act(policy)
        assert len(env.calls) - before <= -(-len(Motion) // (steps - 1))
    env.motion["mutual_information"][:] = 0.0
    env.step_index = np.array(steps)
    assert act(policy)[0] == (Motion.UP if steps > 1 else Motion.STAY)
    assert env.calls[1:] == (list(Motion) if steps > 1 else ["all"])
    env.step_index, env.motion["mutual_information"][Motion.DOWN] = np.array(0), 3.0
    assert act(policy)[0] == Motion.DOWN  # afresh after a reset


@pytest.mark.parametrize(("name", "seeds", "seed"), [("mi-mi", {}, {}), ("random", {"seed": [3, 4]}, {"seed": 3})])
def test_decisions_in_a_batch_out_of_phase_are_those_alone(name: str, seeds: Any, seed: Any) -> None:
    """`mi-mi` spreads its decisions here; `random` draws for each environment by a seed of its own."""
    batch = gym.make_vec("ActiveSLAM-v0", num_envs=2, scenario="hand-held")
    single = gym.make("ActiveSLAM-v0", scenario="hand-held")
    together, alone = baselines.make(name, batch, **seeds), baselines.make(name, single, **seed)
    (observations, _), (observation, _) = batch.reset(seed=0), single.reset(seed=0)
    for k in range(9):
        if k == 2:
            observations, _ = batch.reset(seed=5, options={"reset_mask": np.array((False, True))})
        (actions, _), (action, _) = together.predict(observations), alone.predict(observation)
        np.testing.assert_array_equal(actions[0], action)
        if name == "mi-mi":
            np.testing.assert_array_equal(together._scores[0], alone._scores[0])
        (observations, *_), (observation, *_) = batch.step(actions), single.step(action)


def test_a_choice_for_parts_that_are_objects_has_a_key() -> None:
    assert '"scene": "examples.extend_scene:SphereScene"' in constants.key_of(bare(scene=SphereScene))


BACK_THEN_ORBIT = Sequence(((int(Motion.BACKWARDS), int(Gaze.STAY)), (int(Motion.RIGHT), int(Gaze.LEFT))), (0.54, 1.0))
TIMES = (0.5, 1.0, 3.0)


def bare(**arguments: Any) -> Any:
    return gym.make("ActiveSLAM-v0", **arguments).unwrapped


@pytest.mark.parametrize("module", [constants, sequences])
def test_the_shipped_choices_are_of_the_scenarios_as_they_are_and_the_best_of_their_finalists(module: Any) -> None:
    shipped = json.loads(module.TABLE.read_text(encoding="utf-8"))
    assert "paper" in {entry["scenario"] for entry in shipped.values()}
    for key, entry in shipped.items():
        env = make_environment({"scenario": entry["scenario"]}).unwrapped
        assert key == key_of(env), "regenerate it: python -m baselines"
        chosen = f"{entry['motion']} {entry['gaze']}" if module is constants else sequences.best_sequence(env).words()
        assert max(entry["medians"], key=entry["medians"].get) == chosen


def test_the_choice_has_the_highest_median_in_rooms_of_training_and_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name, rooms in (("ROOMS", 3), ("FINALISTS", 21), ("LAST_ROOMS", 2)):
        monkeypatch.setattr(constants, name, rooms)
    chosen = choose(Scenario(), (1.0, 1.0, 3.0))
    scores = constants.log_scores(CONSTANTS[:, None], Scenario(), range(2**32 + 3, 2**32 + 5), (1.0, 1.0, 3.0))
    medians = {f"{Motion(m).name} {Gaze(g).name}": np.median(row) for (m, g), row in zip(CONSTANTS, scores)}
    assert f"{chosen['motion']} {chosen['gaze']}" == max(medians, key=lambda name: medians[name])
    assert chosen["medians"] == {name: pytest.approx(median, abs=0.06) for name, median in medians.items()}
    env = bare(scenario={"name": "mine", "pixel_std": 2.5}, duration=3.0)
    first = best_constant(env)
    assert "'mine'" in capsys.readouterr().err
    assert best_constant(env) == first and not capsys.readouterr().err


def test_the_command_regenerates_the_named_ones_and_keeps_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {"scenario": "paper", "medians": {"UP LEFT": 1.0}}
    paths = tmp_path / "constants.json", tmp_path / "sequences.json", tmp_path / "readings.json"
    choices = "choose", "choose_sequence", "choose_readings"
    for path, home, choice in zip(paths, (constants, sequences, readings), choices):
        path.write_text(json.dumps({"old": {"scenario": "paper"}, "kept": {"scenario": "hall"}}), encoding="utf-8")
        monkeypatch.setattr(home, "TABLE", path)
        monkeypatch.setattr(home, choice, lambda scenario, *times: made)
    assert table.main(["paper"]) == 0
    for path in paths:
        written = json.loads(path.read_text(encoding="utf-8"))
        assert written == {"kept": {"scenario": "hall"}, key_of(bare()): made}
    assert table.main(["nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_the_policy_plays_the_sequence() -> None:
    env = gym.make("ActiveSLAM-v0", gaze_period=0.5, duration=3.0, end_when_lost=False)
    run = run_episode(env, Planned(env, BACK_THEN_ORBIT.plan(3)), seed=1)
    assert run.log_score[-1] == log_scores([BACK_THEN_ORBIT], Scenario(), [1], TIMES)[0, 0]


def test_the_search_finds_what_is_better_than_every_constant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a world in which only BACKWARDS for a third, then orbit, is worth anything."""
    wanted = Sequence(BACK_THEN_ORBIT.actions, (0.3, 1.0)).plan(35)

    def worths(pool: list[Sequence], scenario: Scenario, seeds: range, **_: Any) -> np.ndarray:
        return np.repeat([[(one.plan(35) == wanted).mean()] for one in pool], len(seeds), axis=1)

    monkeypatch.setattr(sequences, "log_scores", worths)
    monkeypatch.setattr(sequences, "REFINEMENTS", 40)
    found = sequence_from(choose_sequence(Scenario(), (1.0, 1.0, 35.0)))
    held = [constant(action).plan(35) for action in BACK_THEN_ORBIT.actions]
    assert (found.plan(35) == wanted).mean() > 0.9 > max((plan == wanted).mean() for plan in held)
