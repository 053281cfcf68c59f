"""One evaluator for every policy: play its episodes, and record them."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from activeslam_gym.envs.episode import info_at
from activeslam_gym.evaluation.episode import Episode, nearest
from activeslam_gym.motion import Gaze

Array = NDArray[Any]
Look = Callable[[Any, dict[str, Any]], None]
"""Looks at the bare environment and its info, after the reset (the time is 0 then) and after every step."""


class Measure(Protocol):
    """Looks at one episode, and then adds to its record what the record does not have: `Episode.notes`."""

    whole: bool
    """Whether `result` needs every sample of the episode."""

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """See `Look`."""

    def result(self, episode: Episode) -> dict[str, Any]:
        """Numbers and arrays by name, for the whole ``episode``."""


class Predictor(Protocol):
    """Whatever has `predict`: our policies, Stable-Baselines3's models and the users' own."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action for `observation`, and the recurrent state."""


def run_episode(
    env: gym.Env, policy: Predictor, seed: int, name: str = "policy", settings: str = "{}", looks: Sequence[Look] = ()
) -> Episode:
    """Run one episode of `policy`, bound to `env` (a single environment), from `reset(seed=seed)` to its end."""
    return play(env, policy, [seed], name, settings, [looks])[0]


def play(
    env: gym.Env | gym.vector.VectorEnv,
    policy: Predictor,
    seeds: Sequence[int],
    name: str = "policy",
    settings: str = "{}",
    looks: Sequence[Sequence[Look]] = (),
    period: float = 0.0,
) -> list[Episode]:
    """Play the episodes of ``seeds`` with ``policy``, which is bound to ``env``: one, or a batch, to the bit the same.

    ``looks``: for each episode what looks at it. ``period``: time between samples [s], every step if 0; the start and
    the end are always sampled.

    Raises:
        ValueError: the seeds are not as many as the environments, or those do not end together.
    """
    core: Any = env.unwrapped
    batched = hasattr(core, "num_envs")
    rows = [core.run(i) for i in range(core.num_envs)] if batched else [core]
    if len(seeds) != len(rows):
        raise ValueError(f"seeds: {len(seeds)} of them; allowed: {len(rows)}, as many as environments")
    if batched and core.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"env: autoreset_mode {core.autoreset_mode.name}; allowed: DISABLED")
    recorders = [_Recorder(row, looks[i] if looks else (), period) for i, row in enumerate(rows)]
    observation, infos = env.reset(seed=list(seeds) if batched else seeds[0])  # type: ignore[arg-type]
    for i, recorder in enumerate(recorders):
        recorder.see(info_at(infos, i) if batched else infos, False)
    state, first, over = None, True, np.zeros(len(rows), bool)
    while not over.any():
        reads, clock = np.atleast_1d(core.motion_phase) == 0, [perf_counter()]
        start = np.full(len(rows), first)
        action, state = policy.predict(observation, state=state, episode_start=start, deterministic=True)
        clock.append(perf_counter())
        observation, reward, terminated, truncated, infos = env.step(action)
        clock.append(perf_counter())
        first, over = False, np.atleast_1d(np.logical_or(terminated, truncated))
        spent = tuple(np.diff(clock) * 1e6 / len(rows))
        for i, recorder in enumerate(recorders):
            now = (action[i], reads[i], reward[i]) if batched else (action, reads[0], reward)  # type: ignore[index]
            recorder.steps.append((_motion_and_gaze(now[0]), bool(now[1]), float(now[2]), *spent))
            recorder.see(info_at(infos, i) if batched else infos, bool(over[i]))
    if not over.all():
        raise ValueError("env: its episodes do not end together; allowed: a batch with end_when_lost=False")
    return [recorder.episode(name, seed, settings) for recorder, seed in zip(recorders, seeds)]


def matched_ids(core: Any) -> list[int]:
    """Ids of what the detections of the last frame were matched to: features, births too, and −1 − k of fiducial k."""
    matched = core.labels.matched
    return matched[(matched != 0) & (matched >= -core.scenario.fiducial_count)].tolist()


class _Recorder:
    """Takes down one episode; ``core`` is a single environment, or what a batch lets read of one."""

    def __init__(self, core: Any, looks: Sequence[Look], period: float) -> None:
        self._core, self._looks = core, looks
        times = np.arange(round(core.duration / core.gaze_period) + 1) * core.gaze_period
        self._sampled = set(nearest(times, period).tolist()) if period else None
        self._samples: list[dict[str, Any]] = []
        self._marks: list[tuple[float, float]] = []
        self._events: list[dict[str, int]] = []
        self._lost_from = np.nan
        self.steps: list[tuple[Any, ...]] = []

    def see(self, info: dict[str, Any], over: bool) -> None:
        """After the reset, and after every step, which is then in `steps`."""
        for look in self._looks:
            look(self._core, info)
        time = self._core.time
        if self._sampled is None or over or len(self.steps) in self._sampled:
            self._samples.append(_sample(self._core, info))
        while info["landmarks_mapped"] > len(self._marks):
            self._marks.append((time, info["log2_det"]["total"]))
        if self.steps:
            self._events.append(info["events"])
        if info["lost"] and np.isnan(self._lost_from):
            self._lost_from = time

    def episode(self, name: str, seed: int, settings: str) -> Episode:
        """The record, when the episode is over."""
        names = ("actions", "motion_read", "rewards", "decision_us", "step_us")
        columns = (np.array(column) for column in zip(*self.steps, strict=True))
        marks = np.reshape(self._marks, (-1, 2))
        record: dict[str, Any] = {
            **_stacked(self._samples),
            **dict(zip(names, columns)),
            **{"landmark_times": marks[:, 0], "landmark_log2_det": marks[:, 1]},
            **_final(self._core),
            "events": {name: np.array([one[name] for one in self._events], np.int32) for name in self._events[0]},
        }
        return Episode(
            policy=name,
            seed=seed,
            settings=settings,
            lost=bool(not np.isnan(self._lost_from)),
            lost_from=float(self._lost_from),
            room_size=np.array(self._core.scenario.room_size, dtype=float),
            **record,
        )


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
