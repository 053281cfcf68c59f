"""Fly the camera by hand: `python -m activeslam_gym play`.

The command stays until another key changes it, as a policy's does: the turn at once, the translation at the next motion
period. Beside the picture stands what every action promises, by mutual information and by Fisher information.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

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


class Flight:
    """Rooms that are flown by keys in ``env``, from the room of ``seed`` on."""

    def __init__(self, env: gymnasium.Env, seed: int) -> None:
        self._env, self.core = env, env.unwrapped
        self.quit = False
        self.summaries: list[str] = []
        """A line on each episode that was flown to its end."""
        self._enter(seed, "Any key that moves or turns starts the clock")

    def _enter(self, seed: int, caption: str) -> None:
        self.seed, self.caption = seed, caption
        self.motion, self.gaze = Motion.STAY, Gaze.STAY
        self.over = self.running = self._started = self._one_step = False
        self._first_entropy = self._env.reset(seed=seed)[1]["entropy"]
        self.scores = action_scores(self.core)
        """Of the present moment; once it is over, of the last one before."""

    def press(self, key: str) -> None:
        """Do as a key says; other keys change nothing.

        The first key that moves or turns starts the clock; from then on only a pause stops it, and starts it again.
        """
        key = key.lower() if len(key) == 1 else key
        if key == QUIT:
            self.quit = True
        elif key == NEW_ROOM:
            self._enter(self.seed + 1, f"Room {self.seed + 1}")
        elif key in (PAUSE, ONE_STEP):
            self.running, self._one_step = key == PAUSE and not self.running, key == ONE_STEP
            self._started = True
        elif key == HALT:
            self.motion, self.gaze = Motion.STAY, Gaze.STAY
        elif key in MOTION_KEYS or key in GAZE_KEYS:
            motion, gaze = MOTION_KEYS.get(key), GAZE_KEYS.get(key)
            if motion is not None:
                self.motion = Motion.STAY if motion == self.motion else motion
            if gaze is not None:
                self.gaze = Gaze.STAY if gaze == self.gaze else gaze
            self.running, self._started = self.running or not self._started, True

    def advance(self) -> bool:
        """One gaze period under the command, if the clock runs or a single step is due; whether there was one."""
        if self.over or not (self.running or self._one_step):
            return False
        self._one_step = False
        _, _, terminated, truncated, info = self._env.step(np.array((self.motion, self.gaze)))
        bits, self.over = self._first_entropy - info["entropy"], terminated or truncated
        if self.over:
            end = "lost, with the failure penalty" if info["lost"] else f"{bits:.0f} bits of entropy reduction"
            self.summaries.append(
                f"Room {self.seed}: {end}, {info['landmarks_mapped']} landmarks mapped, "
                f"position error {100 * info['position_error']:.1f} cm"
            )
            self.caption = f"{self.summaries[-1]} (n: another room)"
        else:
            self.scores, self.caption = action_scores(self.core), f"{bits:.0f} bits of entropy reduction"
        return True


def action_scores(core: Any) -> dict[str, np.ndarray]:
    """By title, the scores (10,) of the seven motions and the three gazes of a single environment."""
    return {
        title: np.concatenate((core.motion_scores(criterion), core.gaze_scores(criterion)))
        for criterion, title in CRITERIA.items()
    }


def fly(env: gymnasium.Env, cockpit: Cockpit, seed: int = 0, speed: float = 1.0) -> list[str]:
    """Play rooms seed, seed + 1, ... until the user leaves; the summaries of those played to their end.

    Args:
        env: ``ActiveSLAM-v0``, with ``render_mode="rgb_array"`` so that it keeps the history that is drawn.
        cockpit: Where to draw and whence the keys come; anything with its `show`, `keys` and `is_open` will do.
        seed: Of the first room.
        speed: Seconds of the episode in a second.
    """
    flight, changed = Flight(env, seed), True
    core: Any = flight.core
    while True:
        begun = time.monotonic()
        if changed:
            chosen = flight.motion, len(Motion) + flight.gaze
            cockpit.show(core.snapshot(), flight.scores, chosen, flight.caption)
        left = core.gaze_period / speed - (time.monotonic() - begun)
        keys = cockpit.keys(max(left, 1e-3) if flight.running and not flight.over else 0.05)
        for key in keys:
            flight.press(key)
        if flight.quit or not cockpit.is_open:
            return flight.summaries
        changed = flight.advance() or bool(keys)


def play(seed: int = 0, scenario: str = "paper", gaze_period: float | None = None, speed: float = 1.0) -> list[str]:
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


def labels() -> list[list[str]]:
    """The names of motions and gazes with a key for each, as the scores are ordered."""
    groups: tuple[tuple[str, Any, Any], ...] = (("", Motion, MOTION_KEYS), ("gaze ", Gaze, GAZE_KEYS))
    return [
        [f"{prefix}{one.name}  {next((key for key in keys if keys[key] == one), 'space')}" for one in kind]
        for prefix, kind, keys in groups
    ]
