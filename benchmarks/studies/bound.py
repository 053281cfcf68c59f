"""The Cramér–Rao bound of an episode: the covariance that an estimator would have if it linearised at the truth.

It is the posterior bound of Tichavský, Muravchik and Nehorai (1998) for Gaussian noise, of the path that was flown:
P = F P F^T + Q, P^-1 += H^T R^-1 H at the true poses and landmarks, with known labels, the camera's prior and the
room's prior of each landmark. Poses between the samples are interpolated. The errors of that estimator are drawn too:
the share that exceeds the error of a loss is the chance of it that no better linearisation takes away.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from activeslam_gym import Scenario
from activeslam_gym.evaluation import Episode
from activeslam_gym.metrics import LOST_POSITION_ERROR
from activeslam_gym.motion import CAMERA_DIM, CAMERA_SIZE, motion_of, process_covariance, transition_jacobian
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.slam.belief import start_of

DRAWS = 100


class Bound:
    """A measure: ``bound`` (T, 2), deviations of position [m] and orientation [rad], and ``chance`` that it is lost."""

    whole = True

    def __init__(self) -> None:
        self._scenario = Scenario()

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Keep the scenario."""
        self._scenario = core.scenario

    def result(self, episode: Episode) -> dict[str, Any]:
        """The bound at the times of a record with a sample a second."""
        bound, chance = bound_of(self._scenario, episode)
        return {"bound": bound[:: round(1.0 / np.diff(episode.times[:2])[0])], "chance": chance}


def bound_of(scenario: Scenario, episode: Episode) -> tuple[np.ndarray, float]:
    """The deviations of the bound at ``episode.times``, and the chance that an estimator which reaches it gets lost.

    Deviations are (T, 2), of position [m] and orientation [rad], the root of the sum over the axes. The chance is the
    share of ``DRAWS`` drawn errors that exceed the error of a loss at some sample.
    """
    dt, points, known = scenario.frame_time, episode.true_landmarks, len(episode.fiducials)
    frames = round((episode.times[-1] - episode.times[0]) / dt)
    cameras = interpolated(episode, np.arange(frames + 1) * dt)
    samples = np.rint((episode.times - episode.times[0]) / dt).astype(int)
    motion, model = motion_of(scenario, 1.0), PointModel(scenario, np.zeros((0, 2, 3)))
    P = np.diag(
        np.concatenate((start_of(scenario)[1].diagonal(), np.tile(scenario.landmark_prior_variance, len(points))))
    )
    everything = np.concatenate((episode.fiducials, points))
    rng, deviations = np.random.default_rng(episode.seed), [_deviations(P)]
    errors = np.sqrt(P.diagonal())[:, None] * rng.standard_normal((len(P), DRAWS))
    furthest = np.zeros(DRAWS)
    for frame, camera in enumerate(cameras[1:], 1):
        F = transition_jacobian(camera[10:], dt)
        P[:CAMERA_DIM] = F @ P[:CAMERA_DIM]
        P[:, :CAMERA_DIM] = P[:, :CAMERA_DIM] @ F.T
        Q = process_covariance(motion, F, dt)
        P[:CAMERA_DIM, :CAMERA_DIM] += Q
        errors[:CAMERA_DIM] = F @ errors[:CAMERA_DIM] + rng.multivariate_normal(np.zeros(CAMERA_DIM), Q, DRAWS).T
        seen = np.flatnonzero(model.in_view(camera, everything))
        H = np.zeros((len(seen), 2, len(P)))
        for rows, k in zip(H, seen.tolist()):
            _, rows[:, :6], by_point = model.predict(camera, everything[k])
            if k >= known:
                at = CAMERA_DIM + 3 * (k - known)
                rows[:, at : at + 3] = by_point
        if len(seen):
            rows = H.reshape(-1, len(P))
            HP = rows @ P
            S = HP @ rows.T + scenario.pixel_std**2 * np.eye(len(rows))
            P -= HP.T @ np.linalg.solve(S, HP)
            P = 0.5 * (P + P.T)
            noise = scenario.pixel_std * rng.standard_normal((len(rows), DRAWS))
            errors -= HP.T @ np.linalg.solve(S, rows @ errors + noise)
        deviations.append(_deviations(P))
        if frame in samples:
            furthest = np.maximum(furthest, np.linalg.norm(errors[:3], axis=0))
    return np.array(deviations)[samples], float(np.mean(furthest > LOST_POSITION_ERROR))


def _deviations(P: np.ndarray) -> tuple[float, float]:
    return float(np.sqrt(P.diagonal()[:3].sum())), float(np.sqrt(P.diagonal()[3:6].sum()))


def interpolated(episode: Episode, times: np.ndarray) -> np.ndarray:
    """The true cameras (T, 13) at ``times`` after the start."""
    own, out = episode.times - episode.times[0], np.empty((len(times), CAMERA_SIZE))
    turns = Slerp(own, Rotation.from_quat(np.roll(episode.true_quaternion, -1, axis=1)))(np.minimum(times, own[-1]))
    out[:, 3:7] = np.roll(turns.as_quat(), 1, axis=1)
    for axis in range(3):
        out[:, axis] = np.interp(times, own, episode.true_position[:, axis])
    steps = np.diff(times, prepend=times[0] - (times[1] - times[0]))[:, None]
    out[:, 7:10] = np.diff(out[:, :3], axis=0, prepend=out[:1, :3]) / steps
    out[1:, 10:] = (turns[1:] * turns[:-1].inv()).as_rotvec() / steps[1:]
    out[0, 10:] = out[1, 10:]
    return out
