"""One evaluator for every policy: run an episode, and record what happened."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze
from agents.episode import Episode
from baselines.policy import Predictor

Array = NDArray[Any]
Look = Callable[[Any, dict[str, Any]], None]
"""Looks at the bare environment and its info, after the reset (the time is 0 then) and after every step."""


def run_episode(
    env: gym.Env, policy: Predictor, seed: int, name: str = "policy", settings: str = "{}", looks: Sequence[Look] = ()
) -> Episode:
    """Run one episode of `policy`, bound to `env` (a single environment), from `reset(seed=seed)` to its end."""
    core: Any = env.unwrapped
    samples: list[dict[str, Any]] = []
    steps = []

    def look(info: dict[str, Any]) -> None:
        for one in looks:
            one(core, info)
        samples.append(_sample(core, info))

    observation, info = env.reset(seed=seed)
    look(info)
    state, first, ended = None, True, False
    while not ended:
        motion_read = core.motion_phase == 0
        start = perf_counter()
        action, state = policy.predict(observation, state=state, episode_start=np.array([first]), deterministic=True)
        decision_us = (perf_counter() - start) * 1e6
        observation, reward, terminated, truncated, info = env.step(action)
        look(info)
        steps.append((_motion_and_gaze(action), motion_read, float(reward), decision_us))
        first, ended = False, terminated or truncated
    actions, read, rewards, decisions = (np.array(column) for column in zip(*steps, strict=True))
    sampled = _stacked(samples)
    taken = {"actions": actions, "motion_read": read, "rewards": rewards, "decision_us": decisions}
    record: dict[str, Any] = {**sampled, **taken, **_landmark_marks(sampled), **_final(core)}
    return Episode(name, seed, settings, bool(info["lost"]), np.array(core.scenario.room_size, dtype=float), **record)


def matched_ids(core: Any) -> list[int]:
    """What the detections of the last frame were taken for: ids of features, births too, and −1 − k of fiducial k."""
    matched = core.labels.matched
    return matched[(matched != 0) & (matched >= -core.scenario.fiducial_count)].tolist()


def _sample(core: Any, info: dict[str, Any]) -> dict[str, Any]:
    """What is recorded at one time; the rotation offset follows from the quaternions, for all times at once."""
    belief, truth, nees = core.belief, core.truth, core.nees()
    std = np.sqrt(np.maximum(belief.covariance.diagonal()[:6], 0.0))
    copied = ("entropy", "log_score", "landmarks_mapped", "distinct_landmarks", "position_error", "orientation_error")
    kinds = {"position": "position", "orientation": "orientation", "landmark": "landmarks"}
    return {
        "times": core.time,
        **{name: info[name] for name in (*copied, "landmark_rmse")},
        **{f"log2_det_{part}": info["log2_det"][part] for part in ("camera", "map", "total")},
        **{f"{kind}_nees": nees[name] for kind, name in kinds.items()},
        "position_offset": truth.position - belief.position,
        "position_std": std[:3],
        "rotation_std": std[3:],
        "true_position": truth.position,
        "true_quaternion": truth.quaternion,
        "estimated_position": belief.position,
        "estimated_quaternion": belief.quaternion,
    }


def _stacked(samples: list[dict[str, Any]]) -> dict[str, Array]:
    """One array per name over time, and the rotation offset."""
    arrays = {name: np.array([sample[name] for sample in samples]) for name in samples[0]}
    return arrays | {"rotation_offset": _rotation_offset(arrays["true_quaternion"], arrays["estimated_quaternion"])}


def _rotation_offset(true: Array, estimated: Array) -> Array:
    """δθ (T, 3) of R_true = Exp(δθ) R_estimated, from quaternions (T, 4), scalar first."""
    from scipy.spatial.transform import Rotation

    R_true, R_estimated = (Rotation.from_quat(np.roll(q, -1, axis=-1)) for q in (true, estimated))
    return (R_true * R_estimated.inv()).as_rotvec()


def _landmark_marks(sampled: dict[str, Array]) -> dict[str, Array]:
    """When each number of mapped landmarks was first reached, and log₂|P| then."""
    reached = np.maximum.accumulate(sampled["landmarks_mapped"])
    index = np.searchsorted(reached, np.arange(1, reached[-1] + 1))
    return {"landmark_times": sampled["times"][index], "landmark_log2_det": sampled["log2_det_total"][index]}


def _final(core: Any) -> dict[str, Array]:
    """The map at the end, and the truth that it stands for."""
    belief, truth = core.belief, core.truth
    mapped = np.flatnonzero(belief.mapped)
    first = len(belief.covariance) - 3 * len(belief.landmarks)
    blocks = [belief.covariance[i : i + 3, i : i + 3] for i in first + 3 * mapped]
    return {
        "true_landmarks": truth.landmarks,
        "fiducials": truth.fiducials,
        "landmark_errors": core.landmark_errors,
        "estimated_landmarks": belief.landmarks[mapped],
        "landmark_covariance": np.array(blocks).reshape(-1, 3, 3),
    }


def _motion_and_gaze(action: Any) -> tuple[int, int]:
    """Motion and gaze of an action, a pair or the one integer of the discrete action space."""
    motion, gaze = divmod(int(action), len(Gaze)) if np.ndim(action) == 0 else action
    return int(motion), int(gaze)
