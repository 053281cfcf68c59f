"""What is run: the paper's strategies under each choice that it leaves open, and what single claims need."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from activeslam_gym.config import DEPTH_PARTICLES, scenario_from

HERE = "agents.study.strategies"
STRATEGIES = {"mi-constant": "(i)", "mi-mi": "(ii)", "mi-fisher": "(iii)"}
"""The paper's three, by our names."""
LOOKING = ("mi-mi", "mi-fisher")
"""Those of them that choose where to look."""
DEFAULT = "default"
HAND_HELD_SECONDS = 167.0
"""The 2500 frames of figure 5 at 15 a second, in whole seconds."""


@dataclass(frozen=True)
class Condition:
    """One policy under one choice, in every room."""

    choice: str
    """What differs from the defaults."""
    policy: str
    """The role that it plays: one of the strategies, or its own name."""
    source: str
    """Name of the policy as `agents.policies.resolve` takes it."""
    scenario: str = "paper"
    """Name of the scenario."""
    fields: tuple[tuple[str, Any], ...] = ()
    """Fields of the scenario that differ."""
    place: str = ""
    """Where the expected landmarks stand; see `places.PLACES`."""
    duration: float = 35.0
    """Seconds of an episode."""
    every_room: bool = field(default=True, compare=False)
    """Played in every room; otherwise in the first of them, since it only tells what a choice does."""

    @property
    def name(self) -> str:
        """Of its file and of its rows."""
        return f"{self.choice}--{self.policy}"

    def settings(self) -> str:
        """Arguments of the environment, as JSON."""
        return json.dumps(self.environment(), sort_keys=True)

    def environment(self) -> dict[str, Any]:
        """Arguments of `agents.task.make_environment`."""
        given = {"scenario": self.scenario_fields(), "duration": self.duration}
        return given | ({"expected": self.place} if self.place else {})

    def scenario_fields(self) -> dict[str, Any]:
        """The scenario, as plain fields."""
        return {**asdict(scenario_from(self.scenario)), **dict(self.fields)}


@dataclass(frozen=True)
class Choice:
    """One choice that the paper leaves open, made for all three strategies."""

    name: str
    meaning: str
    """What the page says of it."""
    rereads: dict[str, str] = field(default_factory=dict)
    """Strategy → policy that stands for it, where it is not the baseline of that name."""
    scenario: str = "paper"
    fields: tuple[tuple[str, Any], ...] = ()
    place: str = ""

    def conditions(self) -> list[Condition]:
        """The three strategies under this choice."""
        first, sources = self.name == DEFAULT, {name: name for name in STRATEGIES} | self.rereads
        return [
            Condition(self.name, role, source, self.scenario, self.fields, self.place, every_room=first)
            for role, source in sources.items()
        ]


def _rereads(prefix: str, strategies: Sequence[str] = tuple(STRATEGIES)) -> dict[str, str]:
    return {name: f"{HERE}:{prefix}_{name.replace('-', '_')}" for name in strategies}


_PARTICLES = ("initialisation", DEPTH_PARTICLES)
_RAYS_KEPT = (_PARTICLES, ("ray_age", 35.0), ("ray_capacity", 27))

CHOICES: tuple[Choice, ...] = (
    Choice(DEFAULT, "scenario `paper`, undelayed inverse depth"),
    Choice("eigenvalue", "gaze of (iii) by the largest eigenvalue", {"mi-fisher": f"{HERE}:mi_eigenvalue"}),
    Choice("particles", "the paper's depth particles; rays kept 10 s", fields=(_PARTICLES,)),
    Choice("rays-1s", "depth particles; rays kept 1 s", fields=(_PARTICLES, ("ray_age", 1.0))),
    Choice("rays-35s", "depth particles; rays kept to the end, up to 27", fields=_RAYS_KEPT),
    Choice("literal", "scenario `paper-literal`: 45° at the start, depth particles", scenario="paper-literal"),
    Choice("unpropagated", "a candidate motion keeps the present covariance (horizon 0)", _rereads("unpropagated")),
    Choice("gaze-1s", "a candidate gaze is held 1 s before it is scored", _rereads("gaze_ahead", LOOKING)),
    Choice("redrawn", "expected landmarks drawn anew", place="another-draw"),
    Choice("lattice", "expected landmarks on a lattice", place="lattice"),
    Choice("capped", "an expected landmark's pixel varies by no more than the image", _rereads("capped")),
)
"""The default first."""

LIVE_CHOICES = ("hand-held", "calm")
LIVE = "live"
"""Role of the one policy that the paper's live system has: motion by mutual information, gaze the user's."""
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
"""What single claims need."""


def conditions() -> list[Condition]:
    """Every condition once: those of every room first, the default before all."""
    every = [one for choice in CHOICES for one in choice.conditions()] + list(SINGLES)
    return sorted(every, key=lambda one: (not one.every_room, one.choice != DEFAULT))
