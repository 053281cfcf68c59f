"""Fly the camera by hand: `python -m activeslam_gym play`.

The command stays until another key changes it, as a policy's does: the turn at once, the translation at the next motion
period. Beside the picture stands what every action promises, by mutual information and by Fisher information.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np

from activeslam_gym.motion import Gaze, Motion

if TYPE_CHECKING:
    from activeslam_gym.rendering import Cockpit

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


class Flight:
    """A room that is being flown, from its first moment."""

    def __init__(self, env: gymnasium.Env, seed: int, caption: str) -> None:
        self.env, self.seed, self.caption = env, seed, caption
        self.core: Any = env.unwrapped
        _, info = env.reset(seed=seed)
        self.first_entropy = info["entropy"]
        self.scores = action_scores(self.core)
        self.summary: str | None = None
        """One line on the episode, once it is over."""

    def step(self, command: Command) -> None:
        """One gaze period under the command; the scores stay those of the last moment before the end."""
        _, _, terminated, truncated, info = self.env.step(np.array(command))
        bits = self.first_entropy - info["entropy"]
        if terminated or truncated:
            self.summary = summary(self.seed, bits, info)
            self.caption = f"{self.summary} (n: another room)"
        else:
            self.scores = action_scores(self.core)
            self.caption = f"{bits:.0f} bits removed"


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
        cockpit: Where to draw and whence the keys come; anything with its `show`, `keys` and `is_open` will do.
        seed: Of the first room.
        speed: Seconds of the episode in a second.
    """
    told: list[str] = []
    flight = Flight(env, seed, "Any key that moves or turns starts the clock")
    pilot, changed = Pilot(), True
    while True:
        begun = time.monotonic()
        if changed:
            chosen = pilot.command.motion, len(Motion) + pilot.command.gaze
            cockpit.show(flight.core.snapshot(), flight.scores, chosen, flight.caption)
        left = flight.core.gaze_period / speed - (time.monotonic() - begun)
        keys = cockpit.keys(max(left, 1e-3) if pilot.running and not flight.summary else 0.05)
        for key in keys:
            pilot = pilot_after(key, pilot)
        if pilot.quit or not cockpit.is_open:
            return told
        changed = bool(keys)
        if pilot.new_room:
            flight = Flight(env, flight.seed + 1, f"Room {flight.seed + 1}")
            pilot = Pilot()
        elif not flight.summary and (pilot.running or pilot.one_step):
            flight.step(pilot.command)
            pilot, changed = replace(pilot, one_step=False), True
            told += [flight.summary] if flight.summary else []


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

    def key_of(action: Motion | Gaze, keys: Mapping[str, Motion | Gaze]) -> str:
        return next((key for key, what in keys.items() if what == action), "space")

    return (
        [f"{motion.name}  {key_of(motion, MOTION_KEYS)}" for motion in Motion],
        [f"gaze {gaze.name}  {key_of(gaze, GAZE_KEYS)}" for gaze in Gaze],
    )
