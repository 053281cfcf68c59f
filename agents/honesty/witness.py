"""What the hidden labels say of a run, frame by frame: depth errors at conversion, wrong associations, duplicates.

Everything is read between the steps from the arrays behind the environment, so the kernels know nothing of it. A step
must be one frame, or conversions would be seen some frames late.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym.envs.frame import Simulation
from activeslam_gym.motion import POSITION
from activeslam_gym.slam.belief import FEATURES, INVERSE_DEPTH, POINT, RAY, Belief
from agents import policies as policy_sources
from agents.compare import Task, make_environment
from agents.evaluate import Episode, run_episode

Array = NDArray[Any]


@dataclass(frozen=True)
class Testimony:
    """What the hidden labels said of one run."""

    depth_errors: Array
    """(C,) standardised depth errors of the features that became points, see `depth_error`."""
    conversions: int
    """Features that became points, those without an owner too: C of them have one."""
    matches: int
    """Detections matched to a fiducial or to a feature that was there before (births are none)."""
    wrong_matches: int
    """Wrong ones, as the environment counts them (a feature born of clutter is one)."""
    features: int
    """Features that ever had an owner: a true landmark that more than half of their detections were of."""
    duplicates: int
    """Those of them that, at some frame, had their owner in common with an older feature of the map."""


@dataclass(frozen=True)
class WatchedRun:
    """One episode with what was said of it."""

    episode: Episode
    testimony: Testimony
    initialisation: str


class Witness(gym.Wrapper):
    """Passes everything on, and takes down what the labels say after each frame."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        core: Any = env.unwrapped
        if core.setting.task.frames_per_step != 1:
            raise ValueError(f"gaze_period: {core.gaze_period!r}; allowed: one frame, or conversions are seen late")
        self._simulation: Simulation = core._run.simulation  # a referee's look inside: there is no public way
        self._start()

    def _start(self) -> None:
        self._depth_errors: list[float] = []
        self._counts = {"conversions": 0, "matches": 0, "wrong_matches": 0}
        self._owned: set[int] = set()
        self._doubles: set[int] = set()

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Begin anew."""
        self._start()
        return self.env.reset(**arguments)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One frame, and what there is to say of it."""
        belief = self._simulation.belief
        kind, serial, feature = belief.kind.copy(), belief.serial.copy(), belief.feature.copy()
        result = self.env.step(action)
        unfinished = (kind == RAY) | (kind == INVERSE_DEPTH)
        converted = unfinished & (belief.kind == POINT) & (belief.serial == serial)
        for slot in np.flatnonzero(converted):
            self._depth_errors.append(depth_error(self._simulation, int(slot), feature[slot, :3]))
        self._count(result[-1]["events"])
        self._note_owners()
        return result

    def _count(self, events: dict[str, int]) -> None:
        matched = self._simulation.match[: self._simulation.detections.used[0]] >= 0
        self._counts["matches"] += int(np.count_nonzero(matched)) - events["births"]
        self._counts["conversions"] += events["conversions"]
        self._counts["wrong_matches"] += events["wrong_matches"]

    def _note_owners(self) -> None:
        seen: set[int] = set()
        for owner, serial in owners_by_age(self._simulation):
            self._owned.add(serial)
            if owner in seen:
                self._doubles.add(serial)
            seen.add(owner)

    @property
    def testimony(self) -> Testimony:
        """What has been said since the reset."""
        errors = np.array(self._depth_errors)
        return Testimony(
            depth_errors=errors[~np.isnan(errors)],
            features=len(self._owned),
            duplicates=len(self._doubles),
            **self._counts,
        )


def depth_error(simulation: Simulation, slot: int, anchor: Array) -> float:
    """Standardised error of the depth of the POINT in `slot`, along the line of sight from its `anchor` (3,) [m].

    With m the unit vector from the anchor (as it was estimated before the frame) to the estimated point ŷ, depth is
    the distance along m between point and camera, both at this moment: the true one, mᵀ(y − p), minus the estimated
    one, mᵀ(ŷ − p̂), over its standard deviation √(mᵀ (P_yy − P_yp − P_py + P_pp) m). Taken after the update and the
    conversion of the frame. NaN for a feature that belongs to no true landmark.
    """
    world, belief, owner = simulation.world, simulation.belief, int(simulation.labels.owner[slot])
    if owner < 0:
        return np.nan
    y = world.points[len(world.points) - len(simulation.expectation.points) + owner]
    y_hat, p_hat = belief.feature[slot, :3], belief.camera[POSITION]
    m = (y_hat - anchor) / np.linalg.norm(y_hat - anchor)
    error = m @ ((y - world.camera[POSITION]) - (y_hat - p_hat))
    return float(error / np.sqrt(m @ _relative_covariance(belief, slot) @ m))


def _relative_covariance(belief: Belief, slot: int) -> Array:
    """(3, 3) covariance of point minus camera position [m²]."""
    P, camera, at = belief.covariance, slice(0, 3), int(belief.start[slot])
    point = slice(at, at + 3)
    return P[point, point] - P[point, camera] - P[camera, point] + P[camera, camera]


def owners_by_age(simulation: Simulation) -> list[tuple[int, int]]:
    """(owner, serial number) of the features that have an owner, oldest first."""
    slots = simulation.belief.order[: simulation.belief.size[FEATURES]]
    owners, serials = simulation.labels.owner[slots], simulation.belief.serial[slots]
    return [(owner, serial) for owner, serial in zip(owners.tolist(), serials.tolist()) if owner >= 0]


def watch(task: Task) -> WatchedRun:
    """Run one episode under the witness's eyes, in whichever process."""
    settings = json.loads(task.settings)
    env = Witness(make_environment(settings))
    policy = policy_sources.resolve(task.policy, env, task.seed)
    episode = run_episode(env, policy, task.seed, task.policy, task.key)
    env.close()
    return WatchedRun(episode.thinned(), env.testimony, settings["scenario"]["initialisation"])
