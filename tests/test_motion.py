"""The appendix's motion model, and a controller that goes where it is told."""

import numpy as np
import pytest

from activeslam_gym import Gaze, Motion
from activeslam_gym import motion as m
from tests.support import PAPER, random_camera

MODEL = m.motion_of(PAPER, 1.0)
START = np.array([0.0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0])


def drive(motion: int, gaze: int, seconds: float = 1.0, start: np.ndarray = START) -> np.ndarray:
    """The camera after following one command without noise, with a perfect estimate."""
    x = start.copy()
    goal = m.goal_of(MODEL, x, int(motion))
    for frame in range(round(seconds / MODEL.dt)):
        u = m.accelerations(MODEL, x, start[:3], goal, frame * MODEL.dt, m.turn_of(MODEL, int(gaze), frame * MODEL.dt))
        x = m.transition(x, u, MODEL.dt)
    return x


def test_transition_is_the_papers() -> None:
    """p+ = p + (v + a dt) dt, v+ = v + a dt, w+ = w + alpha dt, q+ = Q q with the factor corrected to 1/|w|."""
    rng = np.random.default_rng(0)
    x, u, dt = random_camera(rng), rng.standard_normal(6), 0.05
    p, q, v, w = x[:3], x[3:7], x[7:10], x[10:]
    wx, wy, wz = w_new = w + u[3:] * dt
    M = np.array([[0, -wx, -wy, -wz], [wx, 0, -wz, wy], [wy, wz, 0, -wx], [wz, -wy, wx, 0]])
    norm = np.linalg.norm(w_new)
    Q = np.cos(dt * norm / 2) * np.eye(4) + np.sin(dt * norm / 2) / norm * M
    expected = np.concatenate((p + (v + u[:3] * dt) * dt, Q @ q, v + u[:3] * dt, w_new))
    np.testing.assert_allclose(m.transition(x, u, dt), expected, atol=1e-15)


def test_what_is_commanded_is_limited() -> None:
    """An estimate that jumps by metres does not fling the camera; what a motion takes is far below the limit."""
    goal = np.array([30.0, 0.0, 40.0])
    spun = START.copy()
    spun[10:] = (3.0, 0.0, -4.0)
    u = m.accelerations(MODEL, spun, goal, goal, 0.0, 0.0)
    np.testing.assert_allclose(u, np.array([6.0, 0.0, 8.0, -6.0, 0.0, 8.0]), atol=1e-12)
    x, taken = START, []
    for frame in range(20):
        u = m.accelerations(MODEL, x, START[:3], np.array([0.0, 0.0, 0.3]), frame * MODEL.dt, 0.2)
        x = m.transition(x, u, MODEL.dt)
        taken.append(np.linalg.norm(u.reshape(2, 3), axis=1))
    assert (np.max(taken, axis=0) < (0.3 * m.LARGEST_ACCELERATION, 0.3 * m.LARGEST_ANGULAR_ACCELERATION)).all()


def test_process_noise_of_many_frames_is_that_of_each() -> None:
    rng = np.random.default_rng(1)
    A = rng.standard_normal((12, 12))
    P = P_0 = A @ A.T
    F_x = m.transition_jacobian(np.array([0.0, 0.2, 0.0]), MODEL.dt)
    for _ in range(20):
        P = F_x @ P @ F_x.T + m.process_covariance(MODEL, F_x, MODEL.dt)
    F, Q = m.open_loop(MODEL, 0.2, 20)
    np.testing.assert_allclose(F @ P_0 @ F.T + Q, P, rtol=1e-12, atol=1e-12)


def test_motions_are_along_the_cameras_axes_and_inside_the_room() -> None:
    np.testing.assert_array_equal(m.transition(START, np.zeros(6), 0.05), START)  # at rest it stays
    steps = [drive(motion, Gaze.STAY)[:3] for motion in Motion]  # z is forward, x to the left, y up
    wanted = 0.3 * np.array([(0, 0, 1), (0, 0, -1), (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 0)])
    np.testing.assert_allclose(steps, wanted, atol=1e-9)
    turned = START.copy()
    turned[3:7] = [np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0]  # a quarter turn to the left: faces +X
    np.testing.assert_allclose(drive(Motion.FORWARD, Gaze.STAY, start=turned)[:3], [0.3, 0, 0], atol=0.01)
    x = START.copy()
    x[10:] = [0.3, 0.0, -0.4]
    assert np.abs(drive(Motion.STAY, Gaze.STAY, start=x)[10:]).max() < 1e-3
    np.testing.assert_allclose(m.goal_by(MODEL, START, np.array([5.0, -5.0, 0.3])), [2.6, -0.6, 0.3])


@pytest.mark.parametrize("frames", [0, 1, 5, 20])
def test_a_turn_is_scored_as_the_rate_loop_makes_it(frames: int) -> None:
    """The first frame of a turn from rest is half of the commanded rate's: the loop's time is two frames."""
    for rate, gaze in ((0.0, Gaze.LEFT), (0.3, Gaze.RIGHT), (-0.2, Gaze.STAY)):
        x = START.copy()
        x[11] = rate
        end = drive(Motion.STAY, gaze, frames * MODEL.dt, x)
        angle, left = m.turned_by(MODEL, rate, m.turn_of(MODEL, int(gaze), 0.0), frames)
        assert 2.0 * np.arctan2(end[5], end[3]) == pytest.approx(angle, abs=1e-12)
        assert end[11] == pytest.approx(left, abs=1e-12)
    assert m.turned_by(MODEL, 0.0, 0.2, 1)[0] == pytest.approx(0.005)
