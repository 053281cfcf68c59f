"""Fly the camera by hand: `python -m activeslam_gym play`.

The command stays until another key changes it, as a policy's does: the turn at once, the translation at the next motion
period. Beside the picture stands what every action promises, by mutual information and by Fisher information.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np

from activeslam_gym.envs.views import Snapshot
from activeslam_gym.motion import Gaze, Motion

CRITERIA = {"mutual_information": "Mutual information [bit]", "fisher_trace": "Fisher information"}
"""What is shown of every action, and under which title."""

MOTION_KEYS = {
    "up": Motion.FORWARD,
    "down": Motion.BACKWARDS,
    "w": Motion.FORWARD,
    "s": Motion.BACKWARDS,
    "a": Motion.LEFT,
    "d": Motion.RIGHT,
    "pageup": Motion.UP,
    "pagedown": Motion.DOWN,
    "e": Motion.UP,
    "q": Motion.DOWN,
}
GAZE_KEYS = {"left": Gaze.LEFT, "right": Gaze.RIGHT}
HALT, PAUSE, ONE_STEP, NEW_ROOM, QUIT = " ", "p", ".", "n", "escape"

HELP = """\
  up, down  or  w, s         move forward, backwards
  a, d                       move left, right
  page up, down  or  e, q    move up, down
  left, right                turn left, right
      the same key again stops that; the first of these keys starts the clock
  space                      stop moving and turning
  p                          pause and go on;  .  plays a single step
  n                          a new room
  escape                     leave"""


class Command(NamedTuple):
    """An action of `ActiveSLAM-v0`."""

    motion: Motion = Motion.STAY
    gaze: Gaze = Gaze.STAY


@dataclass(frozen=True)
class Pilot:
    """What the keys so far ask for."""

    command: Command = Command()
    running: bool = False
    """The clock runs: a step every gaze period."""
    started: bool = False
    """The clock has run; from then on only a pause stops it, and starts it again."""
    one_step: bool = False
    """A single step is due."""
    new_room: bool = False
    quit: bool = False


def command_after(key: str, command: Command) -> Command:
    """The command that a key makes of the present one; a key pressed again stops what it began."""
    if key in MOTION_KEYS:
        motion = MOTION_KEYS[key]
        return command._replace(motion=Motion.STAY if motion == command.motion else motion)
    if key in GAZE_KEYS:
        gaze = GAZE_KEYS[key]
        return command._replace(gaze=Gaze.STAY if gaze == command.gaze else gaze)
    return Command() if key == HALT else command


def pilot_after(key: str, pilot: Pilot) -> Pilot:
    """What is asked for after one more key; other keys change nothing."""
    key = key.lower() if len(key) == 1 else key
    if key == QUIT:
        return replace(pilot, quit=True)
    if key == NEW_ROOM:
        return Pilot(new_room=True)
    if key == PAUSE:
        return replace(pilot, running=not pilot.running, started=True)
    if key == ONE_STEP:
        return replace(pilot, running=False, started=True, one_step=True)
    if key in MOTION_KEYS or key in GAZE_KEYS:
        pilot = replace(pilot, running=pilot.running or not pilot.started, started=True)
    return replace(pilot, command=command_after(key, pilot.command))


class Cockpit(Protocol):
    """What `fly` needs of a window: `rendering.Cockpit` on a screen, something simpler in a test."""

    def show(self, snapshot: Snapshot, scores: Mapping[str, np.ndarray], chosen: Iterable[int], caption: str) -> None:
        """Draw; ``scores`` has, by title, the seven motions' and then the three gazes', (10,), of which two chosen."""

    def keys(self, seconds: float) -> list[str]:
        """The keys pressed since the last call, after waiting so long."""

    @property
    def is_open(self) -> bool:
        """Whether the user has left the window open."""


def action_scores(core: Any) -> dict[str, np.ndarray]:
    """By title, the scores (10,) of the seven motions and the three gazes of a single environment."""
    return {
        title: np.concatenate((core.motion_scores(criterion), core.gaze_scores(criterion)))
        for criterion, title in CRITERIA.items()
    }


def summary(seed: int, bits: float, info: dict[str, Any]) -> str:
    """One line on an episode that is over."""
    end = "lost, all forfeited" if info["lost"] else f"{bits:.0f} bits removed"
    return (
        f"Room {seed}: {end}, {info['landmarks_mapped']} landmarks mapped, "
        f"position error {100 * info['position_error']:.1f} cm"
    )


def fly(env: gymnasium.Env, cockpit: Cockpit, seed: int = 0, speed: float = 1.0) -> list[str]:
    """Play rooms seed, seed + 1, ... until the user leaves; the summaries of those played to their end.

    Args:
        env: ``ActiveSLAM-v0``, with ``render_mode="rgb_array"`` so that it keeps the history that is drawn.
        cockpit: Where to draw and whence the keys come.
        seed: Of the first room.
        speed: Seconds of the episode in a second.
    """
    core: Any = env.unwrapped
    told: list[str] = []
    _, info = env.reset(seed=seed)
    pilot, over, first_entropy = Pilot(), False, info["entropy"]
    scores, caption, changed = action_scores(core), "Any key that moves or turns starts the clock", True
    while True:
        begun = time.monotonic()
        if changed:
            cockpit.show(core.snapshot(), scores, (pilot.command.motion, len(Motion) + pilot.command.gaze), caption)
        drawn = time.monotonic() - begun
        keys = cockpit.keys(max(core.gaze_period / speed - drawn, 1e-3) if pilot.running and not over else 0.05)
        for key in keys:
            pilot = pilot_after(key, pilot)
        if pilot.quit or not cockpit.is_open:
            return told
        changed = bool(keys)
        if pilot.new_room:
            seed += 1
            _, info = env.reset(seed=seed)
            pilot, over, first_entropy = Pilot(), False, info["entropy"]
            scores, caption = action_scores(core), f"Room {seed}"
        elif not over and (pilot.running or pilot.one_step):
            _, _, terminated, truncated, info = env.step(np.array(pilot.command))
            pilot, over, changed = replace(pilot, one_step=False), terminated or truncated, True
            bits = first_entropy - info["entropy"]
            caption = f"{bits:.0f} bits removed"
            if over:
                told.append(summary(seed, bits, info))
                caption = f"{told[-1]} (n: another room)"
            else:
                scores = action_scores(core)


def play(seed: int = 0, scenario: str = "paper", gaze_period: float = 0.25, speed: float = 1.0) -> list[str]:
    """Open a window and fly; see `fly`.

    Raises:
        ValueError: a bad argument.
        gymnasium.error.Error: there is no screen, or matplotlib is missing.
    """
    if not speed > 0:
        raise ValueError(f"speed must be positive, got {speed!r}")
    from activeslam_gym import rendering

    env = gymnasium.make("ActiveSLAM-v0", scenario=scenario, gaze_period=gaze_period, render_mode="rgb_array")
    cockpit = rendering.Cockpit(labels())
    try:
        return fly(env, cockpit, seed, speed)
    finally:
        cockpit.close()
        env.close()


def labels() -> tuple[list[str], list[str]]:
    """The names of motions and gazes with a key for each, as the scores are ordered."""
    keys: dict[Any, str] = {}
    for key, motion in MOTION_KEYS.items():
        keys.setdefault(("move", motion), key)
    for key, gaze in GAZE_KEYS.items():
        keys.setdefault(("turn", gaze), key)
    moves = [f"{motion.name}  {keys.get(('move', motion), 'space')}" for motion in Motion]
    turns = [f"gaze {gaze.name}  {keys.get(('turn', gaze), 'space')}" for gaze in Gaze]
    return moves, turns
