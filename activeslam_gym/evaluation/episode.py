"""One way to play an episode with any policy, and the record of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from activeslam_gym.envs.info import info_at
from activeslam_gym.metrics import write_tum
from activeslam_gym.motion import Gaze, Motion, nearest_gaze, nearest_motion

Array = NDArray[Any]
Observer = Callable[[Any, dict[str, Any]], None]
"""Looks at the bare environment and its info, after the reset (the time is 0 then) and after every step."""


@dataclass(frozen=True)
class Episode:
    """One episode of one policy. T samples in time (the start's is the first), K = T − 1 steps, L true landmarks.

    A NEES is per degree of freedom: 1 where the filter is consistent. Quaternions are scalar first. A standard
    deviation is the filter's own.
    """

    policy: str  # its name
    seed: int  # of the reset
    settings: str  # the environment's arguments as JSON: episodes with equal settings belong to one study
    lost: bool  # the belief was lost at some time
    room_size: Array  # (3,) along X, Y, Z [m]

    times: Array  # (T,) [s]
    entropy: Array  # (T,) [bit]
    log2_det_camera: Array  # (T,) log₂|P| of the camera
    log2_det_map: Array  # (T,) log₂|P| of the map, at constant dimension
    log2_det_total: Array  # (T,) log₂|P| of both
    log_score: Array  # (T,) log₂ N(truth | belief), less that of the start [bit]
    landmarks_mapped: Array  # (T,) features that are mapped
    distinct_landmarks: Array  # (T,) true landmarks among them
    position_error: Array  # (T,) [m]
    orientation_error: Array  # (T,) [rad]
    landmark_rmse: Array  # (T,) [m]; inf until a landmark is mapped
    position_nees: Array  # (T,)
    orientation_nees: Array  # (T,)
    landmark_nees: Array  # (T,) mean over the mapped landmarks; NaN before there are any
    position_std: Array  # (T, 3) [m]
    rotation_std: Array  # (T, 3) [rad]
    true_position: Array  # (T, 3) [m]
    true_quaternion: Array  # (T, 4)
    estimated_position: Array  # (T, 3) [m]
    estimated_quaternion: Array  # (T, 4)

    actions: Array  # (K, 2) motion and gaze
    motion_read: Array  # (K,) bool: the step read its motion; elsewhere the one under way went on
    rewards: Array  # (K,)
    decision_us: Array  # (K,) microseconds of `predict`; of a batch, each episode's share

    landmark_times: Array  # (J,) when the number of mapped landmarks first reached 1 … J [s]
    landmark_log2_det: Array  # (J,) log₂|P| of camera and map then

    true_landmarks: Array  # (L, 3) [m]
    fiducials: Array  # (F, 3) [m]
    landmark_errors: Array  # (L,) at the end [m]; NaN for a landmark that is not mapped
    estimated_landmarks: Array  # (n, 3) the mapped features at the end [m]
    landmark_covariance: Array  # (n, 3, 3) their covariances [m²]

    events: dict[str, Array] = field(default_factory=dict)  # of `info["events"]`: (K,) how often in each step
    notes: dict[str, Array] = field(default_factory=dict)  # what measures add, by name

    @property
    def position_offset(self) -> Array:
        """True − estimated position (T, 3) [m]."""
        return self.true_position - self.estimated_position

    @property
    def rotation_offset(self) -> Array:
        """δθ (T, 3) of R_true = Exp(δθ) R_estimated, in the world frame [rad]."""
        from scipy.spatial.transform import Rotation

        true, estimated = (
            Rotation.from_quat(np.roll(q, -1, -1)) for q in (self.true_quaternion, self.estimated_quaternion)
        )
        return (true * estimated.inv()).as_rotvec()

    @property
    def gain(self) -> float:
        """What the log score gained [bit]."""
        return float(self.log_score[-1] - self.log_score[0])

    def arrays(self) -> dict[str, Array]:
        """All of it as arrays, for a store: `events` and `notes` by names with a point."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        nested = {f"{part}.{name}": value for part in NESTED for name, value in values.pop(part).items()}
        return {name: np.asarray(value) for name, value in (values | nested).items()}

    def write_trajectories(self, folder: Path, stem: str) -> list[Path]:
        """Write the true and the estimated trajectory into `folder`, for `evo_ape tum …`; the files."""
        files = {kind: folder / f"{stem}-{kind}.tum" for kind in ("true", "estimated")}
        for kind, path in files.items():
            write_tum(path, self.times, getattr(self, f"{kind}_position"), getattr(self, f"{kind}_quaternion"))
        return list(files.values())

    @classmethod
    def of(cls, arrays: Mapping[str, Array]) -> Episode:
        """The episode of its `arrays`."""
        values: dict[str, Any] = {part: {} for part in NESTED}
        for name, value in arrays.items():
            part, _, inner = name.partition(".")
            if inner:
                values[part][inner] = value
            else:
                values[name] = value if value.ndim else value.item()
        return cls(**values)


NESTED = ("events", "notes")  # the fields that are dicts of arrays


def nearest(times: Array, period: float) -> Array:
    """Indices of the ascending `times` (T,) that are nearest to the multiples of `period`, and of the last."""
    ticks = np.arange(0.0, times[-1] + period, period)
    return np.union1d(np.abs(times[None, :] - ticks[:, None]).argmin(axis=1), len(times) - 1)


TARGET = 14  # the landmark whose time the paper states


def row_of(episode: Episode) -> dict[str, Any]:
    """A row of episodes.csv. What did not happen (no landmark mapped, not `TARGET` of them) is NaN, or empty in a file.

    - ``policy``, ``seed``, ``steps``, ``end_time`` [s], ``lost`` (1 where the belief was lost at some time).
    - ``bits``: the entropy reduction [bit], 0 where lost. ``reward``: the sum of the rewards, in their unit.
    - ``log_score_gain`` [bit], lost or not, for the score itself punishes it; ``log_score_under_0`` and
      ``log_score_under_minus_1000`` are 1 where it is.
    - At the end: ``landmarks_mapped``, ``distinct_landmarks``, ``landmark_rmse`` [m], ``position_error`` [m],
      ``orientation_error`` [rad], ``position_nees`` and ``landmark_nees`` per degree of freedom.
    - ``target_reached``: 1 where `TARGET`, 14, landmarks were mapped, at ``target_time`` [s] with ``target_log2_det``
      log₂|P| of camera and map.
    - ``decision_us``: mean time of `predict` [µs]. ``motion_…`` and ``gaze_…``: how often each was commanded.
    """
    reached = len(episode.landmark_times) >= TARGET
    motions, gazes = episode.actions[episode.motion_read, 0], episode.actions[:, 1]
    return {
        "policy": episode.policy,
        "seed": episode.seed,
        "steps": len(episode.actions),
        "end_time": float(episode.times[-1]),
        "lost": int(episode.lost),
        "bits": 0.0 if episode.lost else float(episode.entropy[0] - episode.entropy[-1]),
        "log_score_gain": episode.gain,
        "log_score_under_0": int(episode.gain < 0.0),
        "log_score_under_minus_1000": int(episode.gain < -1000.0),
        "reward": float(episode.rewards.sum()),
        "landmarks_mapped": int(episode.landmarks_mapped[-1]),
        "distinct_landmarks": int(episode.distinct_landmarks[-1]),
        "landmark_rmse": float(episode.landmark_rmse[-1]) if np.isfinite(episode.landmark_rmse[-1]) else np.nan,
        "position_error": float(episode.position_error[-1]),
        "orientation_error": float(episode.orientation_error[-1]),
        "position_nees": float(episode.position_nees[-1]),
        "landmark_nees": float(episode.landmark_nees[-1]),
        "target_reached": int(reached),
        "target_time": float(episode.landmark_times[TARGET - 1]) if reached else np.nan,
        "target_log2_det": float(episode.landmark_log2_det[TARGET - 1]) if reached else np.nan,
        "decision_us": float(episode.decision_us.mean()),
        **{f"motion_{motion.name.lower()}": int((motions == motion).sum()) for motion in Motion},
        **{f"gaze_{gaze.name.lower()}": int((gazes == gaze).sum()) for gaze in Gaze},
    }


# How it is played -----------------------------------------------------------------------------------------------------


class Measure(Protocol):
    """An observer of one episode that has a `result`, which is added to the record: `Episode.notes`."""

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        """See `Observer`."""

    def result(self, episode: Episode) -> dict[str, Any]:
        """Numbers and arrays by name, of an ``episode`` that is over."""


class Predictor(Protocol):
    """Whatever has `predict`: our policies, Stable-Baselines3's models and the users' own."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action for `observation`, and the recurrent state."""


PolicyLike = Predictor | Callable[[Any], Any]


class Called:
    """The policy of a function ``policy(env)``, which is asked for the action of each step: a `Predictor`.

    A function that returns a `Predictor` is called once, and makes the policy.
    """

    def __init__(self, policy: Callable[[Any], Any], env: gym.Env | gym.vector.VectorEnv) -> None:
        self._policy, self._env = policy, env
        self._made: Predictor | None = None

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action for the environment's present belief, and the recurrent state."""
        if self._made is None:
            answer = self._policy(self._env)
            if answer is None:
                raise ValueError(
                    "policy(env) must return an action, or an object with predict(observation, …), got None"
                )
            if not hasattr(answer, "predict"):
                return answer, state
            self._made = answer
        return self._made.predict(observation, state, episode_start, deterministic)


def bound(policy: PolicyLike, env: gym.Env | gym.vector.VectorEnv) -> Predictor:
    """The ``policy`` as it is, where it can `predict`; a class of policies, or a function, as one bound to ``env``."""
    if isinstance(policy, type):
        return policy(env)
    return policy if hasattr(policy, "predict") else Called(policy, env)


def run_episode(
    env: gym.Env, policy: PolicyLike, seed: int, name: str = "policy", observers: Sequence[Observer] = ()
) -> Episode:
    """Run one episode of `policy` (see `play`) in a single environment, from `reset(seed=seed)` to its end."""
    return play(env, policy, [seed], name, observers=[observers])[0]


def play(
    env: gym.Env | gym.vector.VectorEnv,
    policy: PolicyLike,
    seeds: Sequence[int],
    name: str = "policy",
    settings: str = "{}",
    observers: Sequence[Sequence[Observer]] = (),
    sample_period: float = 0.0,
) -> list[Episode]:
    """Play the episodes of ``seeds`` with ``policy`` in ``env``: one, or a batch, to the bit the same.

    ``policy``: bound to ``env``, or a function ``policy(env)`` that returns an action, or a policy.
    ``observers``: of each episode; a `Measure` is one. ``sample_period``: time between samples [s], every step if 0;
    start and end are always sampled.

    Raises:
        ValueError: seeds or observers are not as many as the environments, or those do not end together; or the
            policy does not return an action and a state.
    """
    core: Any = env.unwrapped
    policy = bound(policy, env)
    batched = hasattr(core, "num_envs")
    rows = [core.run(i) for i in range(core.num_envs)] if batched else [core]
    if len(seeds) != len(rows):
        raise ValueError(f"seeds: {len(seeds)} of them; allowed: {len(rows)}, as many as environments")
    if observers and len(observers) != len(rows):
        raise ValueError(f"observers: {len(observers)} lists; allowed: {len(rows)}, as many as environments")
    if batched and core.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"env: autoreset_mode {core.autoreset_mode.name}; allowed: DISABLED")
    recorder = _Recorder(rows, batched, observers, sample_period)
    observation, infos = env.reset(seed=list(seeds) if batched else seeds[0])  # type: ignore[arg-type]
    recorder.see(infos, False)
    state, first, over = None, True, np.zeros(len(rows), bool)
    while not over.any():
        reads, begun = np.atleast_1d(core.motion_phase == 0), perf_counter()
        start = np.full(len(rows), first)
        answer = policy.predict(observation, state=state, episode_start=start, deterministic=True)
        spent = 1e6 * (perf_counter() - begun) / len(rows)
        is_pair = isinstance(answer, (tuple, list)) and len(answer) == 2
        if not is_pair or env.action_space.shape and all(map(np.isscalar, answer)):  # a motion and a gaze
            raise ValueError(f"predict must return (action, state), got {answer!r:.200}")
        action, state = answer
        observation, reward, terminated, truncated, infos = env.step(action)
        first, over = False, np.atleast_1d(np.logical_or(terminated, truncated))
        paid = np.atleast_1d(np.asarray(reward, float))
        recorder.steps.append((_motions_and_gazes(action, len(rows)), reads, paid, spent))
        recorder.see(infos, bool(over.any()))
    if not over.all():
        raise ValueError("env: its episodes do not end together; allowed: a batch with end_when_lost=False")
    return recorder.episodes(name, seeds, settings)


class _Recorder:
    """Records episodes; ``rows`` are single environments, or the single environments' view of a batch."""

    def __init__(
        self, rows: list[Any], batched: bool, observers: Sequence[Sequence[Observer]], sample_period: float
    ) -> None:
        self._rows, self._batched, self._observers = rows, batched, observers or [()] * len(rows)
        times = np.arange(round(rows[0].duration / rows[0].gaze_period) + 1) * rows[0].gaze_period
        self._sampled = set(nearest(times, sample_period).tolist()) if sample_period else None
        self._samples: list[list[dict[str, Any]]] = [[] for _ in rows]
        self._seen: list[tuple[Any, ...]] = []
        self._events: list[dict[str, Array]] = []
        self.steps: list[tuple[Any, ...]] = []

    def see(self, infos: dict[str, Any], over: bool) -> None:
        """After the reset, and after every step, which is then in `steps`."""
        due = self._sampled is None or over or len(self.steps) in self._sampled
        for i, (core, observers) in enumerate(zip(self._rows, self._observers)):
            if due or observers:
                info = info_at(infos, i) if self._batched else infos
                for observer in observers:
                    observer(core, info)
                if due:
                    self._samples[i].append(_sample(core, info))
        values = infos["lost"], infos["landmarks_mapped"], infos["log2_det"]["total"]
        self._seen.append((self._rows[0].time, *map(np.atleast_1d, values)))
        self._events.append({name: n for name, n in infos["events"].items() if not name.startswith("_")})

    def episodes(self, name: str, seeds: Sequence[int], settings: str) -> list[Episode]:
        """The records, when the episodes are over."""
        actions, reads, rewards, decisions = (np.array(column) for column in zip(*self.steps, strict=True))
        times, lost, mapped, log2_det = (np.array(column) for column in zip(*self._seen, strict=True))
        happened = self._events[1:]
        events = {key: np.array([np.atleast_1d(one[key]) for one in happened], np.int32) for key in happened[0]}
        records = []
        for i, (core, seed) in enumerate(zip(self._rows, seeds)):
            firsts = np.searchsorted(np.maximum.accumulate(mapped[:, i]), np.arange(mapped[:, i].max()) + 1)
            record: dict[str, Any] = {
                **{key: np.array([one[key] for one in self._samples[i]]) for key in self._samples[i][0]},
                **{"actions": actions[:, i], "motion_read": reads[:, i], "rewards": rewards[:, i]},
                "decision_us": decisions,
                **{"landmark_times": times[firsts], "landmark_log2_det": log2_det[firsts, i]},
                **_final(core),
                "lost": bool(lost[:, i].any()),
                "events": {key: count[:, i] for key, count in events.items()},
                "room_size": core.room_size,
            }
            episode = Episode(policy=name, seed=seed, settings=settings, **record)
            for measure in self._observers[i]:
                if hasattr(measure, "result"):
                    episode.notes.update(measure.result(episode))
            records.append(episode)
        return records


def _sample(core: Any, info: dict[str, Any]) -> dict[str, Any]:
    """The record of one time."""
    belief, truth, nees = core.belief, core.truth, core.nees()
    std = np.sqrt(np.maximum(belief.covariance.diagonal()[:6], 0.0))
    copied = ("entropy", "log_score", "landmarks_mapped", "distinct_landmarks", "position_error", "orientation_error")
    kinds = {"position": "position", "orientation": "orientation", "landmark": "landmarks"}
    return {
        "times": core.time,
        **{name: info[name] for name in (*copied, "landmark_rmse")},
        **{f"log2_det_{part}": info["log2_det"][part] for part in ("camera", "map", "total")},
        **{f"{kind}_nees": nees[name] for kind, name in kinds.items()},
        "position_std": std[:3],
        "rotation_std": std[3:],
        "true_position": truth.position,
        "true_quaternion": truth.quaternion,
        "estimated_position": belief.position,
        "estimated_quaternion": belief.quaternion,
    }


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


def _motions_and_gazes(actions: Any, count: int) -> Array:
    """(R, 2) motions and gazes of R actions: pairs, integers of the discrete action space, or the nearest of points."""
    rows = np.asarray(actions).reshape(count, -1)
    if rows.shape[1] == 1:
        rows = np.hstack(np.divmod(rows, len(Gaze)))
    if rows.shape[1] == 4:
        return np.array([(nearest_motion(row), nearest_gaze(row[3])) for row in rows])
    return rows.astype(int)
