"""The batch environment: Gymnasium's own `SyncVectorEnv` over single environments is the law, to the bit."""

import copy
import multiprocessing
import warnings
from collections.abc import Callable
from operator import attrgetter, methodcaller
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import baselines
from activeslam_gym import ActiveSLAMEnv, ActiveSLAMVectorEnv, observation_layout
from activeslam_gym.information.candidates import sequence_plans
from activeslam_gym.threads import Workers

SHORT: dict[str, Any] = {"gaze_period": 0.25, "duration": 3.0, "lost_position_error": 0.04}
"""Some runs are lost on the way, the others end at their duration."""
MODES = list(AutoresetMode)


def same(ours: Any, theirs: Any) -> None:
    """Assert that two trees of arrays are the same: keys, types and every bit."""
    if isinstance(theirs, dict):
        assert set(ours) == set(theirs)
        for key in theirs:
            same(ours[key], theirs[key])
    elif isinstance(theirs, tuple) or getattr(theirs, "dtype", None) == np.object_:
        assert type(ours) is type(theirs)
        for one, other in zip(ours, theirs, strict=True):
            same(one, other)
    else:
        assert type(ours) is type(theirs)
        assert getattr(ours, "dtype", None) == getattr(theirs, "dtype", None)
        np.testing.assert_array_equal(ours, theirs)


def pair(count: int, mode: AutoresetMode, threads: int | None = None, **kwargs: Any) -> tuple[Any, SyncVectorEnv]:
    """Our batch, and Gymnasium's over our single environments."""
    ours = ActiveSLAMVectorEnv(count, num_threads=threads, autoreset_mode=mode, **kwargs)
    return ours, SyncVectorEnv([lambda: ActiveSLAMEnv(**kwargs)] * count, autoreset_mode=mode)


def compare(ours: Any, theirs: Any, steps: int) -> int:
    """Play both alike and assert that all that they return is the same; how many runs were lost on the way."""
    rng, lost = np.random.default_rng(0), 0
    same(ours.reset(seed=3), theirs.reset(seed=3))
    for _ in range(steps):
        actions = rng.integers((7, 3), size=(ours.num_envs, 2))
        returned = ours.step(actions)
        same(returned, theirs.step(actions))
        over = returned[2] | returned[3]
        lost += int(returned[2].sum())
        if over.any() and ours.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            same(ours.reset(options={"reset_mask": over}), theirs.reset(options={"reset_mask": over.copy()}))
    return lost


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_is_the_single_environment_through_every_autoreset(mode: AutoresetMode, threads: int) -> None:
    ours, theirs = pair(5, mode, threads, **SHORT)
    assert ours.metadata["autoreset_mode"] is mode
    assert compare(ours, theirs, steps=40) > 2


def test_any_batch_size_and_a_time_limit() -> None:
    for count in (1, 2, 7):
        compare(*pair(count, AutoresetMode.NEXT_STEP, gaze_period=0.5, duration=8.0), steps=35)
    ours = gym.make_vec("ActiveSLAM-v0", num_envs=2, max_episode_steps=3)
    theirs = gym.make_vec("ActiveSLAM-v0", num_envs=2, vectorization_mode="sync", max_episode_steps=3)
    compare(ours, theirs, steps=9)


@pytest.mark.parametrize("name", ["ActiveSLAM-v0", "ActiveSLAMDiscrete-v0", "ActiveSLAMContinuous-v0"])
def test_make_vec_makes_it_without_a_warning(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env, single = gym.make_vec(name, num_envs=3, autoreset_mode="SAME_STEP"), gym.make(name)
    assert env.spec is not None and env.spec.id == name
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.reset(seed=0)[0] in env.observation_space
    assert env.step(env.action_space.sample())[0] in env.observation_space
    assert env.single_action_space == single.action_space
    assert env.single_observation_space == single.observation_space
    assert observation_layout(env) == observation_layout(single)


def test_seeds() -> None:
    env = ActiveSLAMVectorEnv(3)
    never_seeded, _ = env.reset()
    assert not np.array_equal(*never_seeded[:2]) and len(set(env.np_random_seed)) == 3
    first, _ = env.reset(seed=4)
    assert env.np_random_seed == (4, 5, 6)
    for seed in ([4, 5, 6], np.array([4, 5, 6])):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], first)
    second, _ = env.reset(seed=[None, 5, None])
    np.testing.assert_array_equal(second[1], first[1])
    assert not np.array_equal(second[0], first[0])
    assert len({one.bit_generator.state["state"]["state"] for one in env.np_random}) == 3


def test_what_is_returned_is_fresh() -> None:
    def spoil(tree: Any) -> None:
        for value in tree.values() if isinstance(tree, dict) else tree:
            if isinstance(value, dict) or getattr(value, "dtype", None) == np.object_:
                spoil(value)
            elif isinstance(value, np.ndarray):
                value[...] = 1

    envs = [ActiveSLAMVectorEnv(2, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=3) for _ in range(2)]
    for env in envs:
        env.reset(seed=0)
    for step in range(8):
        returned = [env.step([[step % 7, 0], [1, 2]]) for env in envs]
        same(*returned)
        spoil(returned[0])


def test_a_batch_renders_what_each_renders_alone() -> None:
    pytest.importorskip("matplotlib")
    shared = {"render_mode": "rgb_array", "gaze_period": 0.5, "duration": 1.0}
    env, single = gym.make_vec("ActiveSLAM-v0", num_envs=2, **shared), gym.make("ActiveSLAM-v0", **shared)
    single.reset(seed=0)
    env.reset(seed=0)
    for k in range(2):
        single.step([k, k])
        env.step([[k, k], [k, k]])
    np.testing.assert_array_equal(env.render()[0], single.render())
    env.step(env.action_space.sample())  # past an autoreset
    assert len(env.render()) == 2 and env.render()[1].std() > 5


@pytest.fixture(scope="module")
def played() -> tuple[ActiveSLAMVectorEnv, list[ActiveSLAMEnv]]:
    """A batch on two threads and its single environments, after 6 s of the same actions."""
    batch = ActiveSLAMVectorEnv(3, gaze_period=0.25, num_threads=2)
    singles = [ActiveSLAMEnv(gaze_period=0.25) for _ in range(3)]
    for i, env in enumerate((*singles, batch)):
        env.reset(seed=10 + i % 3)
    for step in range(25):
        actions = [[2 + step // 4 % 2, 1], [step // 4 % 7, 1], [6, 1]]
        batch.step(actions)
        for single, action in zip(singles, actions, strict=True):
            single.step(action)
    return batch, singles


READS = {
    "motion_scores by Fisher": lambda env: env.motion_scores("fisher_trace"),
    "scores of plans": lambda env: env.scores(sequence_plans(5, 2), "mutual_information_camera"),
    "lookahead_scores": lambda env: env.lookahead_scores(2),
    **{name: methodcaller(name) for name in ("motion_scores", "gaze_scores", "joint_scores")},
    **{name: attrgetter(name) for name in ("time", "motion_phase", "landmark_errors")},
    **{f"true {name}": attrgetter(f"truth.{name}") for name in ("position", "landmarks", "fiducials")},
}


@pytest.mark.parametrize("name", READS)
def test_a_batch_reads_with_a_leading_axis(name: str, played: tuple[Any, list[Any]]) -> None:
    batch, singles = played
    ours, theirs = READS[name](batch), [READS[name](single) for single in singles]
    assert isinstance(ours, np.ndarray)
    np.testing.assert_array_equal(ours, theirs)
    same(READS[name](batch.run(1)), theirs[1])


def test_what_grows_with_the_map_is_one_array_for_each(played: tuple[Any, list[Any]]) -> None:
    batch, singles = played
    for i, single in enumerate(singles):
        for name in ("position", "landmarks", "mapped", "ids", "converted", "covariance"):
            np.testing.assert_array_equal(getattr(batch.belief[i], name), getattr(single.belief, name))
        for name, value in single.nees().items():
            np.testing.assert_array_equal(batch.nees()[name][i], value)
        same(vars(batch.run(i).labels), vars(single.labels))
        same(batch.run(i).predicted_belief._asdict(), single.predicted_belief._asdict())
    for name in ("scenario", "gaze_period", "motion_period", "duration", "steps_per_motion", "observation_space"):
        assert name == "observation_space" or getattr(batch, name) == getattr(singles[0], name)
        assert batch.call(name) == batch.get_attr(name) == tuple(getattr(single, name) for single in singles)
    np.testing.assert_array_equal(batch.get_attr("time"), [one.time for one in singles])


@pytest.mark.parametrize(
    ("name", "mode"),
    [*((one, AutoresetMode.NEXT_STEP) for one in baselines.names() if one != "best-sequence")]
    + [(one, AutoresetMode.SAME_STEP) for one in ("sweep", "mi-fisher", "greedy-plus")],
)
def test_a_baseline_does_in_a_batch_what_it_does_alone(name: str, mode: AutoresetMode) -> None:
    """Through autoreset; `random` draws for the whole batch, so is only run. `best-sequence` plays a plan, as
    `best-constant` does, and would search for one first."""
    kwargs = {"gaze_period": 0.5, "duration": 3.0}
    batch, single = ActiveSLAMVectorEnv(3, autoreset_mode=mode, **kwargs), gym.make("ActiveSLAM-v0", **kwargs)
    policy, alone = baselines.make(name, batch), baselines.make(name, single)
    (observations, _), (observation, _) = batch.reset(seed=0), single.reset(seed=1)
    over = False
    for _ in range(14):
        actions, _ = policy.predict(observations)
        assert actions in batch.action_space
        if name != "random":
            np.testing.assert_array_equal(observations[1], observation)
        observations, *_ = batch.step(actions)
        if not over:
            observation, _, terminated, truncated, _ = single.step(alone.predict(observation)[0])
            over = terminated or truncated
            if mode is AutoresetMode.NEXT_STEP:
                continue
        if over:
            (observation, _), over = single.reset(), False


def rollout(env: ActiveSLAMVectorEnv, put: Callable[[np.ndarray], None]) -> None:
    """Put the observations after a few steps."""
    env.reset(seed=5)
    for _ in range(6):
        observations, *_ = env.step(np.zeros((env.num_envs, 2), int))
    put(observations)


@pytest.mark.parametrize("method", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_child_process_has_its_own_threads(method: str) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    env, here, context = ActiveSLAMVectorEnv(4, num_threads=2), [], multiprocessing.get_context(method)
    rollout(env, here.append)
    results = context.SimpleQueue()
    child = context.Process(target=rollout, args=(env, results.put))
    child.start()
    child.join(120)
    assert child.exitcode == 0, "the child hangs or has failed"
    np.testing.assert_array_equal(results.get(), here[0])


@pytest.mark.parametrize("make", [lambda: ActiveSLAMVectorEnv(2, num_threads=2), ActiveSLAMEnv])
def test_a_copy_goes_its_own_way(make: Any) -> None:
    env = make()
    turn, stay = (np.broadcast_to(one, env.action_space.shape) for one in ([6, 1], [6, 2]))
    env.reset(seed=0)
    env.step(turn)
    twin, before = copy.deepcopy(env), env.motion_scores()
    returned = twin.step(stay)
    np.testing.assert_array_equal(env.motion_scores(), before)
    same(env.step(stay), returned)
    np.testing.assert_array_equal(env.motion_scores(), twin.motion_scores())


def test_an_error_in_a_thread_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        Workers(4, 2).call(lambda start, stop: 1 // (start == 0))


def test_a_reset_is_asked_for_and_next_step_ignores_the_action_of_an_ended_run() -> None:
    env, stay = ActiveSLAMVectorEnv(2, autoreset_mode="DISABLED", max_episode_steps=1), [[0, 0], [0, 0]]
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1\]"):
        env.step(stay)
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\]"):
        env.step(stay)
    env.reset()
    env.step(stay)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(stay)
    env = ActiveSLAMVectorEnv(2, max_episode_steps=1)
    env.reset(seed=0)
    env.step([[0, 0], [0, 0]])
    _, *numbers, _ = env.step(np.full((2, 2), np.nan))
    assert not np.any(numbers) and env.time.tolist() == [0.0, 0.0]
