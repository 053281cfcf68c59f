"""One evaluator for every policy: run an episode, and record what happened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze
from agents.files import written_whole
from baselines.policy import Predictor

Array = NDArray[Any]
Look = Callable[[Any, dict[str, Any]], None]
"""Looks at the bare environment and its info at one time."""


@dataclass(frozen=True)
class Episode:
    """One episode of one policy. T samples in time (the start's is the first), K = T − 1 steps, L true landmarks."""

    policy: str
    """Name of the policy."""
    seed: int
    """Seed of the reset."""
    settings: str
    """What the environment was made with, as JSON: episodes with equal settings belong to one study."""
    lost: bool
    """The belief was lost, which ended the episode."""
    room_size: Array
    """(3,) m, along X, Y, Z."""

    times: Array
    """(T,) s."""
    entropy: Array
    """(T,) bits."""
    log2_det_camera: Array
    """(T,) log₂|P| of the camera."""
    log2_det_map: Array
    """(T,) log₂|P| of the map, at constant dimension."""
    log2_det_total: Array
    """(T,) log₂|P| of both."""
    log_score: Array
    """(T,) bits: log₂ N(truth | belief)."""
    landmarks_mapped: Array
    """(T,) features that are mapped."""
    distinct_landmarks: Array
    """(T,) true landmarks among them."""
    position_error: Array
    """(T,) m."""
    orientation_error: Array
    """(T,) rad."""
    landmark_rmse: Array
    """(T,) m; inf until something is mapped."""
    position_nees: Array
    """(T,) of the position, per degree of freedom: 1 where the filter is honest."""
    orientation_nees: Array
    """(T,) of the orientation, per degree of freedom."""
    landmark_nees: Array
    """(T,) mean over the mapped landmarks, per degree of freedom; NaN before there are any."""
    position_offset: Array
    """(T, 3) m, true − estimated."""
    position_std: Array
    """(T, 3) m, the filter's own."""
    rotation_offset: Array
    """(T, 3) rad: δθ of R_true = Exp(δθ) R_estimated, in the world frame."""
    rotation_std: Array
    """(T, 3) rad, the filter's own."""
    true_position: Array
    """(T, 3) m."""
    true_quaternion: Array
    """(T, 4), scalar first."""
    estimated_position: Array
    """(T, 3) m."""
    estimated_quaternion: Array
    """(T, 4), scalar first."""

    actions: Array
    """(K, 2) motion and gaze."""
    motion_read: Array
    """(K,) bool: the step read its motion; elsewhere the one under way went on."""
    rewards: Array
    """(K,)."""
    decision_us: Array
    """(K,) microseconds of `predict`."""

    landmark_times: Array
    """(J,) s: when the number of mapped landmarks first reached 1 … J."""
    landmark_log2_det: Array
    """(J,) log₂|P| of camera and map then."""

    true_landmarks: Array
    """(L, 3) m."""
    fiducials: Array
    """(F, 3) m."""
    landmark_errors: Array
    """(L,) m, at the end; NaN for a landmark that is not mapped."""
    estimated_landmarks: Array
    """(n, 3) m, the mapped features at the end."""
    landmark_covariance: Array
    """(n, 3, 3) m², theirs."""

    def thinned(self, period: float = 1.0) -> Episode:
        """The same with samples every `period` s and at the end; steps and final values stay whole."""
        ticks = np.arange(0.0, self.times[-1] + period, period)
        kept = np.unique(np.abs(self.times[None, :] - ticks[:, None]).argmin(axis=1))
        kept = np.union1d(kept, len(self.times) - 1)
        return replace(self, **{name: getattr(self, name)[kept] for name in SAMPLED})

    def save(self, path: Path) -> None:
        """Write to `path` (.npz), whole or not at all."""
        with written_whole(path, "wb") as file:
            np.savez_compressed(file, **asdict(self))

    @classmethod
    def load(cls, path: Path) -> Episode:
        """Read what `save` wrote."""
        with np.load(path) as data:
            return cls(**{f.name: data[f.name][()] if data[f.name].ndim else data[f.name].item() for f in fields(cls)})


_NAMES = [f.name for f in fields(Episode)]
SAMPLED = tuple(_NAMES[_NAMES.index("times") : _NAMES.index("actions")])
"""The fields with one entry for each time."""


def run_episode(
    env: gym.Env, policy: Predictor, seed: int, name: str = "policy", settings: str = "{}", looks: Sequence[Look] = ()
) -> Episode:
    """Run one episode of `policy`, bound to `env` (a single environment), from `reset(seed=seed)` to its end.

    Each of `looks` is called with the bare environment and its info, after the reset and after every step.
    """
    core: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    _look(looks, core, info)
    samples, steps = [_sample(core, info)], []
    state, first, ended = None, True, False
    while not ended:
        motion_read = core.motion_phase == 0
        start = perf_counter()
        action, state = policy.predict(observation, state=state, episode_start=np.array([first]), deterministic=True)
        decision_us = (perf_counter() - start) * 1e6
        observation, reward, terminated, truncated, info = env.step(action)
        _look(looks, core, info)
        samples.append(_sample(core, info))
        steps.append((_motion_and_gaze(action), motion_read, float(reward), decision_us))
        first, ended = False, terminated or truncated
    actions, read, rewards, decisions = (np.array(column) for column in zip(*steps, strict=True))
    sampled = _stacked(samples)
    return Episode(
        policy=name,
        seed=seed,
        settings=settings,
        lost=bool(info["lost"]),
        room_size=np.array(core.scenario.room_size, dtype=float),
        actions=actions,
        motion_read=read,
        rewards=rewards,
        decision_us=decisions,
        **sampled,
        **_landmark_marks(sampled),
        **_final(core),
    )


def _look(looks: Sequence[Look], core: Any, info: dict[str, Any]) -> None:
    """Call those that look on."""
    for look in looks:
        look(core, info)


def _sample(core: Any, info: dict[str, Any]) -> dict[str, Any]:
    """What is recorded at one time; the rotation offset follows from the quaternions, for all times at once."""
    belief, truth, nees = core.belief, core.truth, core.nees()
    std = np.sqrt(np.maximum(belief.covariance.diagonal()[:6], 0.0))
    copied = ("entropy", "log_score", "landmarks_mapped", "distinct_landmarks", "position_error", "orientation_error")
    return {
        "times": core.time,
        **{name: info[name] for name in (*copied, "landmark_rmse")},
        **{f"log2_det_{part}": info["log2_det"][part] for part in ("camera", "map", "total")},
        "position_nees": nees["position"],
        "orientation_nees": nees["orientation"],
        "landmark_nees": nees["landmarks"],
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
