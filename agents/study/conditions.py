"""Conditions: the paper's strategies under each choice that it leaves open, others for single claims; their rows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.config import DEPTH_PARTICLES, scenario_from
from activeslam_gym.evaluation import TARGET, Episode, Store
from agents.study.measures import Observer
from agents.task import Task, results

Array = NDArray[np.float64]
Row = dict[str, Any]  # numbers of one episode, and its curves; see `measures.measures`

HERE = "agents.study.strategies"
STRATEGIES = {"mi-constant": "(i)", "mi-mi": "(ii)", "mi-fisher": "(iii)"}  # the paper's three, by our names
DEFAULT = "default"
HAND_HELD_SECONDS = 167.0  # the 2500 frames of figure 5 at 15 a second, in whole seconds
CURVES = ("log2_det_camera", "log2_det_map", "log2_det_total")  # curves of a row, at whole seconds


@dataclass(frozen=True)
class Condition:
    """One policy under one choice."""

    choice: str  # the difference from the defaults
    policy: str  # the role that it plays: one of the strategies, or its own name
    source: str  # name of the policy as `agents.policies.resolve` takes it
    scenario: str = "paper"  # name of the scenario
    fields: tuple[tuple[str, Any], ...] = ()  # fields of the scenario that differ
    place: str = ""  # where the expected landmarks stand; see `places.PLACES`
    duration: float = 35.0  # seconds of an episode
    every_room: bool = field(default=True, compare=False)
    """Played in every room; otherwise in the first of them, since it only tells the effect of a choice."""

    def environment(self) -> dict[str, Any]:
        """Arguments of `agents.task.make_environment`."""
        scenario = {**asdict(scenario_from(self.scenario)), **dict(self.fields)}
        given = {"scenario": scenario, "duration": self.duration}
        return given | ({"expected": self.place} if self.place else {})

    def task(self, seed: int) -> Task:
        """The episode in a room."""
        return Task(self.source, seed, json.dumps(self.environment(), sort_keys=True), measures=(Observer,))


class Choice(NamedTuple):
    """One choice that the paper leaves open, made for all three strategies."""

    name: str
    meaning: str  # its line on the page
    conditions: list[Condition]


def _choice(name: str, meaning: str, rereads: Mapping[str, str] | None = None, **setting: Any) -> Choice:
    """A choice; `rereads`: strategy → policy that stands for it, where it is not the baseline of that name."""
    sources = {role: role for role in STRATEGIES} | dict(rereads or {})
    first = name == DEFAULT
    return Choice(name, meaning, [Condition(name, *one, every_room=first, **setting) for one in sources.items()])


def _rereads(prefix: str) -> dict[str, str]:
    return {name: f"{HERE}:{prefix}_{name.replace('-', '_')}" for name in STRATEGIES}


_PARTICLES = ("initialisation", DEPTH_PARTICLES)
_RAYS_KEPT = (_PARTICLES, ("ray_age", 35.0), ("ray_capacity", 27))

CHOICES: tuple[Choice, ...] = (
    _choice(DEFAULT, "scenario `paper`, undelayed inverse depth"),
    _choice("eigenvalue", "gaze of (iii) by the largest eigenvalue", {"mi-fisher": f"{HERE}:mi_eigenvalue"}),
    _choice("particles", "the paper's depth particles; rays kept 10 s", fields=(_PARTICLES,)),
    _choice("rays-1s", "depth particles; rays kept 1 s", fields=(_PARTICLES, ("ray_age", 1.0))),
    _choice("rays-35s", "depth particles; rays kept to the end, up to 27", fields=_RAYS_KEPT),
    _choice("literal", "scenario `paper-literal`: 45° at the start, depth particles", scenario="paper-literal"),
    _choice("unpropagated", "a candidate motion keeps the present covariance (horizon 0)", _rereads("unpropagated")),
    _choice("gaze-1s", "a candidate gaze is held 1 s before it is scored", fields=(("gaze_horizon", 1.0),)),
    _choice("redrawn", "expected landmarks drawn again", place="another-draw"),
    _choice("lattice", "expected landmarks on a lattice", place="lattice"),
    _choice("capped", "an expected landmark's pixel varies by no more than the image", _rereads("capped")),
)
"""The default first."""

LIVE_CHOICES = ("hand-held", "calm")
LIVE = "live"  # role of the one policy that the paper's live system has: motion by mutual information, gaze the user's
_CALM = (
    ("pixel_std", 1.0),
    ("filter_acceleration_std", 2.0),
    ("filter_angular_acceleration_std", 1.0),
    ("scripted_gaze_amplitude", 0.15),
)
"""A steadier hand and a sharper detector, in the place of the appearance by which the live system tells features."""
PARTICLES_NOWHERE = "particles-nowhere"
SINGLES: tuple[Condition, ...] = (
    Condition("default", "fisher-fisher", "fisher-fisher"),
    Condition("eigenvalue", "fisher-fisher", f"{HERE}:eigenvalue_eigenvalue", every_room=False),
    Condition("unpropagated", "fisher-fisher", f"{HERE}:unpropagated_fisher_fisher", every_room=False),
    *(Condition("nowhere", name, name, place="nowhere") for name in STRATEGIES),
    *(Condition(PARTICLES_NOWHERE, x, x, "paper", (_PARTICLES,), "nowhere", every_room=False) for x in STRATEGIES),
    Condition("hand-held", LIVE, "mi-mi", "hand-held", duration=HAND_HELD_SECONDS),
    Condition("calm", LIVE, "mi-mi", "hand-held", _CALM, duration=HAND_HELD_SECONDS),
    *(Condition("clutter", name, name, "clutter") for name in (*STRATEGIES, "sweep", "random")),
)
"""Conditions that single claims need."""


def conditions() -> list[Condition]:
    """Every condition once: those of every room first, the default before all."""
    every = [one for choice in CHOICES for one in choice.conditions] + list(SINGLES)
    return sorted(every, key=lambda one: (not one.every_room, one.choice != DEFAULT))


# Rows ---------------------------------------------------------------------------------------------------------------


class Rows(dict[tuple[str, str], list[Row]]):
    """(choice, policy) → a row for each room, by seed."""

    duration = 35.0  # of the simulation [s]: the paper's, or shorter for a quick look


def run_conditions(plan: Mapping[Condition, Sequence[int]], store: Store, jobs: int) -> Rows:
    """The rows of every condition in its rooms, by their seeds. Conditions with equal settings share episodes."""
    tasks = {(one, seed): one.task(seed) for one, seeds in plan.items() for seed in seeds}
    found = {task: _row(episode) for task, episode in results(list(dict.fromkeys(tasks.values())), store, jobs)}
    return Rows({(one.choice, one.policy): [found[tasks[one, seed]] for seed in seeds] for one, seeds in plan.items()})


def _row(episode: Episode) -> Row:
    row = {name: value.tolist() for name, value in episode.notes.items()} | {"curve_time": episode.times.tolist()}
    return row | {f"curve_{name}": getattr(episode, name).tolist() for name in CURVES}


def column(rows: Sequence[Row], name: str) -> Array:
    """(rooms,) a number of each run."""
    return np.array([row[name] for row in rows], dtype=float)


def while_alive(rows: Sequence[Row], name: str) -> Array:
    """(rooms,) a number of each run; NaN for a lost one, whose error and entropy mean nothing."""
    return np.where(column(rows, "lost") == 1.0, np.nan, column(rows, name))


def at_target(rows: Sequence[Row], ladder: str, otherwise: float = np.nan) -> Array:
    """(rooms,) the value when `TARGET` landmarks were mapped, or `otherwise` where they never were."""
    ladders = [row[ladder] for row in rows]
    return np.array([one[TARGET - 1] if len(one) >= TARGET else otherwise for one in ladders], dtype=float)


def lead_at_common_rung(ladder: str, ours: Sequence[Row], theirs: Sequence[Row], duration: float = 0.0) -> Array:
    """(rooms,) ours − theirs at the most landmarks that both reached in a room, `TARGET` at most; NaN for none.

    Rooms in which one of them never reached `TARGET` are not left out: they are compared on a lower rung.
    """
    leads = []
    for own, other in zip(ours, theirs, strict=True):
        rung = min(len(own[ladder]), len(other[ladder]), TARGET)
        leads.append(own[ladder][rung - 1] - other[ladder][rung - 1] if rung else np.nan)
    return np.array(leads)
