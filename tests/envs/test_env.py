"""The contract of ActiveSLAM-v0 as a Gymnasium environment."""

import copy
import json
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import activeslam_gym
import baselines
from activeslam_gym import SCENARIOS, Gaze, Motion
from activeslam_gym.envs.actions import INDICES, PAIRS, POINTS, Encoding
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.envs.step import BEGIN
from activeslam_gym.motion import COMMANDS
from tests.record_frozen import numbers
from tests.support import CAMERA, moments, pixel_of, python, random_actions, replaced, simulation_of

IDS = ("ActiveSLAM-v0", "ActiveSLAMDiscrete-v0", "ActiveSLAMContinuous-v0")
INFO = set("entropy log2_det log_score landmarks_mapped distinct_landmarks position_error orientation_error".split())
INFO |= set("landmark_rmse position_nees lost lost_at_end reward_terms events".split())


def made(**kwargs):
    """The environment itself, in steps of a quarter of a second."""
    return gym.make("ActiveSLAM-v0", **{"gaze_period": 0.25, **kwargs}).unwrapped


def detections_of(env) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """(what, its pixel, where the paper's camera would have seen it) of each detection of the last frame."""
    run = simulation_of(env)
    points = np.concatenate((run.world.fiducials, run.world.landmarks))
    labels = env.unwrapped.labels.detected.tolist()
    pixels = run.detections["pixel"][: len(labels)]
    return [
        (label, pixel.copy(), pixel_of(CAMERA, run.world.state.camera, points[label]))
        for label, pixel in zip(labels, pixels, strict=True)
    ]


def test_the_nees_of_info_is_that_of_nees_per_degree_of_freedom() -> None:
    env = made()
    env.reset(seed=0)
    info = env.step((Motion.LEFT, Gaze.LEFT))[4]
    error, P = env.truth.position - env.belief.position, env.belief.covariance[:3, :3]
    assert info["position_nees"] == env.nees()["position"] == pytest.approx(error @ np.linalg.solve(P, error) / 3.0)


@pytest.mark.parametrize("name", IDS)
def test_checkers_pass_without_a_warning(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(name, duration=2.0).unwrapped, skip_render_check=True)
        sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
        sb3.check_env(gym.make(name, duration=2.0), warn=True)


@pytest.mark.parametrize("name", IDS)
def test_spec_survives_json(name: str) -> None:
    env = gym.make(name, scenario={"landmark_count": 9, "room_size": (4.0, 2.0, 4.0)}, gaze_period=0.25, duration=2.0)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(json.loads(json.dumps(env.spec.to_json()))))
    assert again.unwrapped.scenario == env.unwrapped.scenario
    np.testing.assert_array_equal(env.reset(seed=3)[0], again.reset(seed=3)[0])


def test_same_seed_same_run_after_the_first_reset_too() -> None:
    one, other = made(), made()
    for seed in (5, None, None):
        (a, ra, ia), (b, rb, ib) = (moments(env, seed, random_actions(12)) for env in (one, other))
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(ra, rb)
        assert [numbers(i) for i in ia] == [numbers(i) for i in ib]
    assert not np.array_equal(*(moments(one, seed, random_actions(2))[0] for seed in (5, 6)))


def test_noise_does_not_depend_on_the_actions() -> None:
    """Two policies in the same room: whatever both see of a point in a frame has the same noise."""
    noises = []
    for motion in (Motion.LEFT, Motion.UP):
        env = made(gaze_period=0.05)
        env.reset(seed=11)
        for _ in range(30):
            env.step((motion, Gaze.STAY))
        noises.append({label: pixel - hidden for label, pixel, hidden in detections_of(env)})
    common = noises[0].keys() & noises[1].keys()
    assert len(common) >= 3
    for label in common:
        np.testing.assert_allclose(noises[0][label], noises[1][label], atol=1e-9)


@pytest.mark.parametrize("reward", REWARDS)
def test_rewards_sum_to_the_gain_of_their_potential(reward: str) -> None:
    _, rewards, infos = moments(made(duration=10.0, reward=reward), 2, random_actions(40))
    assert not infos[-1]["lost"]
    assert rewards.sum() == pytest.approx(sum(info["reward_terms"][reward] for info in infos), abs=1e-9)
    if reward in ("entropy", "log_score"):
        gain = infos[-1][reward] - infos[0][reward]
        assert rewards.sum() == pytest.approx(-gain if reward == "entropy" else gain, abs=1e-6)


def test_time_limit_truncates_and_a_reset_is_asked_for() -> None:
    env = made(duration=1.0)
    env.reset(seed=0)
    assert [env.step((6, 2))[2:4] for _ in range(4)] == [(False, False)] * 3 + [(False, True)]
    new = made(render_mode="rgb_array")
    for call in (lambda: env.step((6, 2)), lambda: new.step((6, 2)), new.snapshot, new.render):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            call()
    for env in (gym.make("ActiveSLAM-v0").unwrapped, gym.make_vec("ActiveSLAM-v0", num_envs=2).unwrapped):
        for scores in (env.motion_scores, env.gaze_scores, env.joint_scores, env.lookahead_scores):
            with pytest.raises(gym.error.ResetNeeded, match="reset"):
                scores()


def test_motion_is_read_once_a_period_and_gaze_at_once() -> None:
    env = made()
    under_way = activeslam_gym.observation_layout(env).global_slices["motion"]
    env.reset(seed=0)
    seen = [env.step((motion, Gaze.LEFT))[0][under_way] for motion in (Motion.UP, *[Motion.DOWN] * 3)]
    assert np.argmax(seen[0]) == np.argmax(seen[1]) == Motion.UP
    assert env.belief.angular_velocity[1] == pytest.approx(0.2, abs=0.1)
    assert np.argmax(env.step((Motion.DOWN, Gaze.RIGHT))[0][under_way]) == Motion.DOWN
    assert env.belief.angular_velocity[1] < 0.1


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.slow) for s in range(4, 20))])
def test_public_covariance_stays_symmetric_positive_definite(seed: int) -> None:
    env, rng, ended = made(lost_position_error=100.0), np.random.default_rng(seed), False
    env.reset(seed=seed)
    while not ended:
        _, _, terminated, truncated, _ = env.step(rng.integers((7, 3)))
        ended = terminated or truncated
        P = env.belief.covariance
        np.testing.assert_allclose(P, P.T, rtol=1e-9, atol=1e-15)
        np.linalg.cholesky(P)
    assert truncated


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_scenario_runs(scenario: str) -> None:
    env = gym.make("ActiveSLAM-v0", scenario=scenario, duration=3.0)
    observations, rewards, infos = moments(env, 1, random_actions(100))
    assert len(rewards) >= 1 and np.isfinite(observations).all()
    assert observations.shape[1:] == env.observation_space.shape
    for info in infos:
        assert info.keys() == INFO and not np.isnan(list(numbers(info).values())).any()


def test_observation_holds_nothing_of_the_truth_but_its_detections() -> None:
    env = made()
    env.reset(seed=9)
    for _ in range(12):
        env.step((2, 1))
    other = copy.deepcopy(env)
    world = simulation_of(other).world
    world.state.camera[:3] += 0.1
    world.landmarks[:] += 0.3
    for one in (env, other):
        one._play(BEGIN, 0.0)  # evaluates and observes the run as it is
    here, there = simulation_of(env), simulation_of(other)
    assert here.episode.evaluation.position_error != there.episode.evaluation.position_error
    np.testing.assert_array_equal(here.observation, there.observation)


def test_objects_are_fresh_and_views_read_only() -> None:
    env = gym.make("ActiveSLAM-v0")
    observation, info = env.reset(seed=0)
    kept, entropy = observation.copy(), info["entropy"]
    belief = env.unwrapped.belief
    env.step((0, 0))
    np.testing.assert_array_equal(observation, kept)
    assert info["entropy"] == entropy
    with pytest.raises(ValueError, match="read-only"):
        belief.covariance[0, 0] = 1.0
    with pytest.raises(ValueError, match="part must be one of camera, map, total, got 'room'"):
        belief.log2_det("room")


WALL, BEHIND = ((-3.0, -1.0, 0.3), (3.0, 1.0, 0.4)), ((-3.0, -1.0, -3.0), (3.0, 1.0, -2.0))
"""A box across the whole room, in front of the first camera."""


def started(**scenario):
    """An environment of the paper with other fields, after one frame."""
    env = made(scenario=scenario, gaze_period=0.05)
    env.reset(seed=4)
    env.step((6, 2))
    return env


def test_only_who_knows_of_a_box_reckons_with_it() -> None:
    knows, does_not = (started(boxes=(BEHIND,), boxes_known=known) for known in (True, False))
    in_view = activeslam_gym.observation_layout(knows).token_slices["in_view"]
    for env, sees in ((knows, False), (does_not, True)):
        simulation_of(env).world.boxes[0] = WALL  # no room is drawn with one that hides the fiducials
        env.step((6, 2))
        assert len(env.labels.detected) == 0
        scores = (env.motion_scores()[Motion.STAY], env.gaze_scores()[Gaze.STAY], env.joint_scores()[6, 2])
        assert [bool(score) for score in scores] == [sees] * 3
        assert bool(len(env.snapshot().predicted)) == sees
        layout = activeslam_gym.observation_layout(env)
        tokens = simulation_of(env).observation[layout.tokens].reshape(layout.token_shape)
        assert bool(tokens[:, in_view].any()) == sees
        assert len(env.predicted_belief.boxes) == (not sees)


@pytest.mark.parametrize("lens", [{"focal": 210.0}, {"distortion": 0.0}, {"focal": 240.0, "distortion": 0.0}])
def test_a_wrong_calibration_moves_the_detections_and_not_what_is_expected(lens: dict[str, float]) -> None:
    fields, right = {"focal": "true_focal_px", "distortion": "true_distortion"}, started()
    wrong = started(**{fields[name]: value for name, value in lens.items()})
    run = simulation_of(wrong)
    assert run.models.lens == simulation_of(right).models.lens
    points = np.concatenate((run.world.fiducials, run.world.landmarks))
    true_camera, noise = replaced(CAMERA, **lens), {label: pixel - z for label, pixel, z in detections_of(right)}
    assert run.models.true_lens == true_camera
    both = [one for one in detections_of(wrong) if one[0] in noise]
    assert len(both) > 5
    for label, pixel, by_filter in both:
        z, centre = pixel_of(true_camera, run.world.state.camera, points[label]), (CAMERA.u0, CAMERA.v0)
        np.testing.assert_allclose(pixel - z, noise[label], atol=1e-9)
        assert len(lens) == 1 or np.linalg.norm(z - centre) > 1.2 * np.linalg.norm(by_filter - centre)
    if len(lens) == 1:
        np.testing.assert_allclose(wrong.snapshot().predicted[0], right.snapshot().predicted[0], atol=8.0)


ACTIONS: dict[str, tuple[Encoding, list, list]] = {
    "two whole numbers, a motion in 0 … 6 .*": (
        PAIRS,
        [(2, 1), (6.0, 0)],
        [(7, 0), (0, 3), (-1, 0), (0,), (0, 0, 0), 3, (np.nan, 0), (0.5, 0), "up", None, ((0, 0), (0,))],
    ),
    "one whole number in 0 … 20": (INDICES, [7, 18.0], [21, -1, 0.5, np.nan, (1, 2), None]),
    "four numbers in -1 … 1": (POINTS, [COMMANDS[2, 1], COMMANDS[6, 0]], [(0, 1), (0, 0, 0, 1.5), (np.nan,) * 4, "up"]),
}


@pytest.mark.parametrize("allowed", ACTIONS)
def test_actions_are_read_alike_alone_and_in_a_batch_or_are_refused(allowed: str) -> None:
    (encoding, good, bad), commands = ACTIONS[allowed], COMMANDS[(2, 6), (1, 0)]
    np.testing.assert_array_equal(encoding.read(good, np.ones(2, bool)), commands)
    np.testing.assert_array_equal([encoding.read_one(action) for action in good], commands)
    drawn = encoding.space().sample()
    np.testing.assert_array_equal(encoding.read([drawn], np.ones(1, bool))[0], encoding.read_one(drawn))
    ended = [good[0], np.full(encoding.shape, np.nan)]
    np.testing.assert_array_equal(encoding.read(ended, np.array([True, False]))[0], commands[0])
    for action in bad:
        with pytest.raises(ValueError, match=f"^action must be {allowed}.* got"):
            encoding.read_one(action)
        with pytest.raises(ValueError, match=f"^actions.* {allowed}.* got"):
            encoding.read([action, action], np.ones(2, bool))


def test_a_baseline_plays_the_same_run_by_points_as_by_pairs() -> None:
    given = {"scenario": "office", "gaze_period": 0.25, "motion_period": 0.5, "duration": 3.0}
    pairs, points = gym.make("ActiveSLAM-v0", **given), gym.make("ActiveSLAMContinuous-v0", **given)
    seen, other = pairs.reset(seed=1)[0], points.reset(seed=1)[0]
    policies = baselines.make("mi-mi", pairs), baselines.make("mi-mi", points)
    for _ in range(12):
        pair, point = policies[0].predict(seen)[0], policies[1].predict(other)[0]
        assert point in points.action_space
        seen, other = pairs.step(pair)[0], points.step(point)[0]
        np.testing.assert_array_equal(seen, other)


def moved(action: np.ndarray) -> tuple[np.ndarray, float]:
    """Displacement [m] and turn [rad] of two periods of one action from a start at rest."""
    scenario = {"acceleration_std": 0.0, "angular_acceleration_std": 1e-9}
    env = gym.make("ActiveSLAMContinuous-v0", scenario=scenario, gaze_period=0.25)
    env.reset(seed=0)
    before = env.unwrapped.truth
    for _ in range(8):
        env.step(action)
    after = env.unwrapped.truth
    turn = np.arctan2(after.quaternion[2], after.quaternion[0]) - np.arctan2(before.quaternion[2], before.quaternion[0])
    return after.position - before.position, 2.0 * turn


def test_half_an_action_does_half_of_it_and_a_long_one_is_shortened() -> None:
    half, full = moved(np.array([0.0, 0.0, 0.5, 0.5])), moved(np.array([0.0, 0.0, 1.0, 1.0]))
    assert half[1] == pytest.approx(0.5 * full[1], abs=0.02) and full[1] == pytest.approx(0.4, abs=0.05)
    assert np.linalg.norm(half[0]) == pytest.approx(0.5 * np.linalg.norm(full[0]), abs=0.05)
    long, _ = moved(np.array([1.0, 1.0, 1.0, 0.0]))
    assert np.linalg.norm(long) == pytest.approx(0.6, abs=0.08)
    np.testing.assert_allclose(long / np.linalg.norm(long), np.full(3, 3**-0.5), atol=0.15)


@pytest.mark.parametrize("name", IDS[:2])
def test_a_mask_leaves_all_motions_where_one_is_read_and_the_one_under_way_elsewhere(name: str) -> None:
    """Of a single environment and of each in a batch."""
    one, envs = gym.make(name, gaze_period=0.25).unwrapped, gym.make_vec(name, num_envs=3, gaze_period=0.25)
    action = np.array((Motion.UP, Gaze.LEFT) if name == IDS[0] else 3 * Motion.UP + Gaze.LEFT)
    under_way = [Motion.UP, 7, 8, 9] if name == IDS[0] else [3 * Motion.UP + gaze for gaze in Gaze]
    one.reset(seed=0)
    envs.reset(seed=0)
    for step in range(5):
        masks = envs.unwrapped.action_masks()
        np.testing.assert_array_equal(masks, [one.action_masks()] * 3)
        assert np.flatnonzero(masks[0]).tolist() == (under_way if step % 4 else [*range(masks.shape[1])])
        one.step(action)
        envs.step(np.stack([action] * 3))


def test_it_runs_without_compilation_and_means_the_same() -> None:
    """In a process of its own, where the id's prefix is what registers it."""
    code = (
        "import gymnasium as gym\n"
        "env = gym.make('activeslam_gym:ActiveSLAM-v0', gaze_period=0.25); env.reset(seed=0)\n"
        "for _ in range(4): *_, info = env.step((2, 1))\n"
        "print(env.spec.id, repr(info['entropy']))"
    )
    entropies = []
    for disabled in ("0", "1"):
        name, entropy = python("-c", code, NUMBA_DISABLE_JIT=disabled).split()
        assert name == "ActiveSLAM-v0"
        entropies.append(float(entropy))
    assert entropies[0] == pytest.approx(entropies[1], abs=1e-6)
