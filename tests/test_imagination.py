"""What is imagined is what is believed: nothing of the truth enters, and everything of the belief does."""

from typing import Any

import numpy as np
import pytest

import baselines
from activeslam_gym import ActiveSLAMEnv, ActiveSLAMVectorEnv, Gaze, Motion
from activeslam_gym.camera import View, visible
from activeslam_gym.envs.context import TIME_LEFT
from activeslam_gym.envs.imagination import DECIDED, Hindsight, Imagination, slowed
from activeslam_gym.envs.referee import NOBODY
from activeslam_gym.evaluation import play, run_episode
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.metrics import camera_error
from activeslam_gym.motion import CAMERA_DIM, QUATERNION
from activeslam_gym.slam.draws import drawn_from
from baselines.rollout import Rollout, halvings

ORBIT = (int(Motion.RIGHT), int(Gaze.LEFT))
SHORT: dict[str, Any] = {"gaze_period": 0.5, "end_when_lost": False}


def flown(
    seconds: float = 4.0, seed: int = 3, action: tuple[int, int] = ORBIT, **arguments: Any
) -> tuple[ActiveSLAMEnv, Imagination]:
    """An action, such as an orbit, held for some seconds, and what could be imagined from then on."""
    env = ActiveSLAMEnv(**{"duration": 8.0, **SHORT, **arguments})
    env.reset(seed=seed)
    imagination = Imagination(env, seed=1, threads=1)
    imagination.look()
    for _ in range(round(seconds / env.gaze_period)):
        env.step(action)
        imagination.look()
    return env, imagination


def lie(env: Any) -> None:
    """Replace everything that a policy must not know, and keep the belief."""
    runs, rng = env._runs, np.random.default_rng(99)
    runs.world.state["camera"][:, :3] += 1.0
    runs.world.state["noise_key"] = rng.integers(2**63)
    runs.world.landmarks[...] = rng.uniform(-1.0, 1.0, runs.world.landmarks.shape)
    runs.world.boxes[...] = np.array([[-3.0, -1.0, -3.0], [3.0, 1.0, -2.9]])
    runs.owner["label"], runs.owner["landmark"] = -1, NOBODY
    runs.label[...], runs.candidate["pixel"] = -1, 0.0
    runs.models["true_camera"]["focal"] *= 2.0
    runs.episode["redraw_key"] = 7
    for name in runs.episode["evaluation"].dtype.names:
        runs.episode["evaluation"][name] = 5
    for name in ("potential", "terms", "first_density", "lost", "lost_now", "detections", "reward", "total"):
        runs.episode[name] = 1


@pytest.mark.parametrize("boxes", [(), (((0.5, -1.0, 1.0), (0.8, 1.0, 1.6)),)])
def test_the_truth_the_noise_to_come_and_the_labels_change_no_decision(boxes: Any) -> None:
    scenario = {"boxes": boxes, "missed_detection_probability": 0.05, "clutter_rate": 1.0, "true_focal_px": 200.0}
    decisions = []
    for deceived in (False, True):
        env, _ = flown(0.0, scenario=scenario, duration=5.0)
        policy, chosen = Rollout(env, budget=8, base=ORBIT, threads=1), []
        for step in range(6):
            if deceived and step == 4:
                lie(env)
            chosen.append(policy.predict(env._runs.observation[0])[0].tolist())
            if step < 5:
                env.step(ORBIT)
        decisions.append((chosen, policy._searches[0].plan.tolist()))
    assert decisions[0] == decisions[1]


def test_the_deception_would_be_seen_by_who_reads_the_truth() -> None:
    worths = []
    for deceived in (False, True):
        env, _ = flown()
        told = Hindsight(env, seed=1, threads=1)
        if deceived:
            lie(env)
        told.draw(1)
        worths.append(told.play([0], np.tile(ORBIT, (1, 4, 1))).log_density[0])
    assert worths[0] != worths[1]


def test_what_is_drawn_is_distributed_as_the_belief() -> None:
    env, _ = flown(6.0)
    belief, rng = env._run.ekf, np.random.default_rng(0)
    half, dim = np.array([50.0, 50.0, 50.0]), CAMERA_DIM
    drawn = [drawn_from(belief, half, rng) for _ in range(400)]
    errors = np.array([camera_error(camera, belief.state.camera) for camera, _ in drawn])
    P = belief.covariance[:dim, :dim]
    nees = np.einsum("mi,ij,mj->m", errors, np.linalg.inv(P), errors) / dim
    assert abs(nees.mean() - 1.0) < 4.0 * np.sqrt(2.0 / dim / len(drawn))
    public = env.belief
    sure = np.flatnonzero(public.converted)
    assert len(sure) >= 3
    for k in sure:
        offset = np.array([points[k] for _, points in drawn]) - public.landmarks[k]
        block = public.covariance[dim + 3 * k : dim + 3 * k + 3, dim + 3 * k : dim + 3 * k + 3]
        d = np.einsum("mi,ij,mj->m", offset, np.linalg.inv(block), offset) / 3.0
        assert abs(d.mean() - 1.0) < 4.0 * np.sqrt(2.0 / 3.0 / len(drawn))


@pytest.mark.parametrize("scenario", ["paper", "paper-literal"])
def test_rooms_have_all_landmarks_inside_and_every_feature_its_own(scenario: str) -> None:
    env, imagination = flown(5.0, scenario=scenario)
    imagination.draw(6)
    half = 0.5 * np.array(env.scenario.room_size)
    rooms = imagination._rooms
    assert (np.abs(rooms.world.landmarks) <= half + 1e-9).all()
    assert len({tuple(room.ravel()) for room in rooms.world.landmarks}) == 6
    n = int(env._run.ekf.state.count)
    assert n > 3
    assert rooms.owner["landmark"][:, :n].tolist() == [list(range(n))] * 6
    assert (rooms.world.fiducials == env._run.world.fiducials).all()
    assert len(np.unique(rooms.world.state["noise_key"])) == 6


def test_no_unfound_landmark_is_imagined_where_the_camera_looks() -> None:
    env, imagination = flown(4.0)
    imagination.draw(20)
    pose, z = env._run.ekf.state.camera, np.empty(2)
    view = View(env._run.models.camera, pose, rotation_matrix(pose[QUATERNION]))
    n = int(env._run.ekf.state.count)
    unfound = imagination._rooms.world.landmarks[:, n:].reshape(-1, 3)
    in_view = np.mean([visible(view, y, -20.0, z) for y in unfound])
    anywhere = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 3)) * np.array(env.scenario.room_size)
    assert in_view < 0.01 < 0.05 < np.mean([visible(view, y, -20.0, z) for y in anywhere])


def test_boxes_that_the_belief_does_not_know_are_drawn_where_nothing_contradicts_them() -> None:
    env, imagination = flown(3.0, scenario="office", duration=8.0)
    imagination.draw(8)
    worlds, z, count = imagination._rooms.world, np.empty(2), int(env._run.ekf.state.count)
    numbers = worlds.state["boxes"].tolist()
    assert count > 3 and max(numbers) > 0
    for number, boxes, pose, landmarks in zip(numbers, worlds.boxes, worlds.state["camera"], worlds.landmarks):
        known, R_WC = np.vstack((landmarks[:count], worlds.fiducials[0])), rotation_matrix(pose[QUATERNION])
        for point in np.vstack((pose[:3], landmarks[:count])):
            assert not ((boxes[:number, 0] < point) & (point < boxes[:number, 1])).all(axis=1).any()
        with_boxes, without = (View(env._run.models.camera, pose, R_WC, boxes[:n]) for n in (number, 0))
        assert all(visible(with_boxes, y, 0.0, z) == visible(without, y, 0.0, z) for y in known)
        assert not any((box == own).all() for box in boxes[:number] for own in env._run.world.boxes)


def test_a_plan_may_leave_its_actions_to_a_policy() -> None:
    env, imagination = flown(2.0)
    imagination.draw(3)
    seen = []

    def circles(observations: np.ndarray, contexts: np.ndarray) -> np.ndarray:
        seen.append((observations.copy(), contexts[:, TIME_LEFT].tolist()))
        return np.tile(ORBIT, (len(observations), 1))

    held, left = (np.full((3, imagination.periods, 2), action) for action in (0, DECIDED))
    held[:] = ORBIT
    ends = [imagination.play([0, 1, 2], plans, circles).entropy for plans in (held, left)]
    np.testing.assert_array_equal(*ends)
    assert len(seen) == imagination.periods
    np.testing.assert_array_equal(seen[0][0], np.tile(env._run.observation, (3, 1)))  # the present one
    np.testing.assert_allclose(
        10.0 ** (2.0 * np.array([times[0] for _, times in seen])) - 1.0, np.arange(6, 0, -1), rtol=1e-5
    )
    policy = Rollout(env, budget=8, base=circles, threads=1)
    env._run.estimate.covariance[3, 3] = np.nan  # nothing can be drawn: the policy alone decides
    assert tuple(policy.predict(env._runs.observation[0])[0].tolist()) == ORBIT


@pytest.mark.parametrize(
    ("scenario", "action", "begun_at", "duration", "least", "most"),
    [("paper", ORBIT, 4.0, 16.0, 0.9, 1.25), ("corner", (int(Motion.BACKWARDS), int(Gaze.LEFT)), 1.0, 12.0, 0.75, 1.1)],
)
def test_imagined_runs_come_to_what_real_ones_do(
    scenario: str, action: tuple[int, int], begun_at: float, duration: float, least: float, most: float
) -> None:
    """By entropy, over rooms: long frames are a model. With frames of 0.25 s it is 0.63 in `corner`."""
    offsets = []
    for seed in range(4):
        env, imagination = flown(begun_at, seed, action, duration=duration, scenario=scenario)
        imagination.draw(6)
        imagined = imagination.play(range(6), np.tile(action, (6, imagination.periods, 1))).entropy
        over, begun = False, float(env._runs.episode["evaluation"]["entropy"][0])
        while not over:
            *_, over, info = env.step(action)
        offsets.append((imagined.mean() - begun) / (info["entropy"] - begun))
    assert least < np.mean(offsets) < most


def test_long_frames_tell_and_disturb_as_much_in_a_second() -> None:
    env, _ = flown(0.0)
    own = env._run.models
    models, stride = slowed(own)
    assert (stride, models.motion.dt) == (2, pytest.approx(0.1))
    assert models.camera.pixel_std**2 * stride == pytest.approx(own.camera.pixel_std**2)
    assert models.motion.acceleration_std**2 * stride == pytest.approx(own.motion.acceleration_std**2)
    assert models.task.frames_per_step * models.motion.dt == pytest.approx(env.motion_period)
    assert models.true_camera == models.camera
    assert own.task.frames_per_step == 10 and own.camera.pixel_std == 2.0  # untouched


def test_a_belief_that_is_no_number_keeps_the_plan() -> None:
    env, imagination = flown(0.0)
    policy = Rollout(env, budget=8, base=ORBIT, threads=1)
    assert imagination.possible
    env._run.estimate.covariance[3, 3] = np.nan
    assert not imagination.possible
    assert tuple(policy.predict(env._runs.observation[0])[0].tolist()) == ORBIT


def test_a_question_asked_twice_takes_no_second_step_of_the_plan() -> None:
    env, _ = flown(0.0)
    policy = Rollout(env, budget=8, base=ORBIT, threads=1)
    for _ in range(2):
        policy.predict(env._runs.observation[0])
        assert len(policy._searches[0].plan) == 8
    env.step(ORBIT), env.step(ORBIT)
    policy.predict(env._runs.observation[0])
    assert len(policy._searches[0].plan) == 7


def test_threads_change_nothing() -> None:
    ends = []
    for threads in (1, 2):
        env, _ = flown(2.0)
        imagination = Imagination(env, seed=1, threads=threads)
        imagination.draw(3)
        ends.append(imagination.play([0, 1, 2] * 12, np.tile(ORBIT, (36, imagination.periods, 1))).entropy)
    assert (ends[0] == ends[1]).all() and (ends[0].reshape(12, 3) == ends[0][:3]).all()


def test_plans_begin_with_a_motion_of_their_own() -> None:
    env, imagination = flown(1.0)
    env.step(ORBIT)
    with pytest.raises(ValueError, match="motion"):
        imagination.draw(1)


@pytest.mark.parametrize(("plans", "budget"), [(2, 8), (6, 24), (18, 72), (64, 256)])
def test_halving_keeps_two_and_spends_the_budget(plans: int, budget: int) -> None:
    spent, left = 0, plans
    for keep, rooms in halvings(plans, budget):
        spent, left = spent + left * rooms, keep
    assert left == 2 and 0.8 * budget <= spent <= 1.25 * budget


def test_a_batch_decides_as_its_single_environments_do() -> None:
    kwargs: dict[str, Any] = {"duration": 3.0, **SHORT}
    batch, env = ActiveSLAMVectorEnv(2, num_threads=1, autoreset_mode="DISABLED", **kwargs), ActiveSLAMEnv(**kwargs)
    together = play(batch, Rollout(batch, budget=8, base=ORBIT, threads=1), [5, 6])
    for run in together:
        alone = run_episode(env, Rollout(env, budget=8, base=ORBIT, threads=1), run.seed)
        np.testing.assert_array_equal(run.actions, alone.actions)
        np.testing.assert_array_equal(run.entropy, alone.entropy)


def test_the_same_seed_plans_the_same_and_a_small_budget_is_refused() -> None:
    plans = []
    for seed in (0, 0, 1):
        env, _ = flown(0.0, duration=6.0)
        policy = Rollout(env, budget=16, base=ORBIT, seed=seed, threads=1)
        policy.predict(env._runs.observation[0])
        plans.append(policy._searches[0].imagination._rooms.world.landmarks.tolist())
    assert plans[0] == plans[1] != plans[2]
    with pytest.raises(ValueError, match="budget"):
        baselines.make("rollout", env, budget=4)


@pytest.mark.slow
def test_the_planner_beats_its_base() -> None:
    leads = []
    for seed in range(4):
        env = ActiveSLAMEnv(duration=20.0, **SHORT)
        policies = baselines.make("orbit", env), Rollout(env, budget=16, base=ORBIT, threads=1)
        base, planned = (run_episode(env, policy, seed).log_score[-1] for policy in policies)
        leads.append(planned - base)
    assert np.mean(leads) > 0.0
