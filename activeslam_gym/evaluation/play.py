"""One evaluator for every policy: play its episodes, and record them."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from activeslam_gym.envs.info import info_at
from activeslam_gym.evaluation.episode import Episode, nearest
from activeslam_gym.motion import Gaze

Array = NDArray[Any]
Observer = Callable[[Any, dict[str, Any]], None]
"""Looks at the bare environment and its info, after the reset (the time is 0 then) and after every step."""


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
    period: float = 0.0,
) -> list[Episode]:
    """Play the episodes of ``seeds`` with ``policy`` in ``env``: one, or a batch, to the bit the same.

    ``policy``: bound to ``env``, or a function ``policy(env)`` that returns an action, or a policy.
    ``observers``: of each episode; a `Measure` is one. ``period``: time between samples [s], every step if 0; start and
    end are always sampled.

    Raises:
        ValueError: the seeds are not as many as the environments, or those do not end together.
    """
    core: Any = env.unwrapped
    policy = bound(policy, env)
    batched = hasattr(core, "num_envs")
    rows = [core.run(i) for i in range(core.num_envs)] if batched else [core]
    if len(seeds) != len(rows):
        raise ValueError(f"seeds: {len(seeds)} of them; allowed: {len(rows)}, as many as environments")
    if batched and core.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"env: autoreset_mode {core.autoreset_mode.name}; allowed: DISABLED")
    recorder = _Recorder(rows, batched, observers, period)
    observation, infos = env.reset(seed=list(seeds) if batched else seeds[0])  # type: ignore[arg-type]
    recorder.see(infos, False)
    state, first, over = None, True, np.zeros(len(rows), bool)
    while not over.any():
        reads, begun = np.atleast_1d(core.motion_phase == 0), perf_counter()
        start = np.full(len(rows), first)
        action, state = policy.predict(observation, state=state, episode_start=start, deterministic=True)
        spent = 1e6 * (perf_counter() - begun) / len(rows)
        observation, reward, terminated, truncated, infos = env.step(action)
        first, over = False, np.atleast_1d(np.logical_or(terminated, truncated))
        paid = np.atleast_1d(np.asarray(reward, float))
        recorder.steps.append((_motions_and_gazes(action, batched), reads, paid, spent))
        recorder.see(infos, bool(over.any()))
    if not over.all():
        raise ValueError("env: its episodes do not end together; allowed: a batch with end_when_lost=False")
    return recorder.episodes(name, seeds, settings)


def matched_ids(core: Any) -> list[int]:
    """Ids of the matches of the last frame: of features, also new ones, and −1 − k of fiducial k."""
    matched = core.labels.matched
    return matched[(matched != 0) & (matched >= -core.scenario.fiducial_count)].tolist()


class _Recorder:
    """Records episodes; ``rows`` are single environments, or the single environments' view of a batch."""

    def __init__(self, rows: list[Any], batched: bool, observers: Sequence[Sequence[Observer]], period: float) -> None:
        self._rows, self._batched, self._observers = rows, batched, observers or [()] * len(rows)
        times = np.arange(round(rows[0].duration / rows[0].gaze_period) + 1) * rows[0].gaze_period
        self._sampled = set(nearest(times, period).tolist()) if period else None
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
                "room_size": np.array(core.scenario.room_size, dtype=float),
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


def _motions_and_gazes(action: Any, batched: bool) -> Array:
    """(R, 2) motions and gazes of an action, pairs or the integers of the discrete action space."""
    is_index = np.ndim(action) == int(batched)
    return np.reshape(np.stack(np.divmod(action, len(Gaze)), axis=-1) if is_index else action, (-1, 2)).astype(int)
