"""One environment: `env.step` through `gymnasium.make`, in the middle of a sweep."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from .report import Bar, Section
from .setups import sweep_action, swept
from .timing import Timing, summary, timed


def run(quick: bool) -> Section:
    """Steps per second, with CartPole's beside them."""
    section = Section("One environment")
    repeats = 2 if quick else 7
    cartpole = 1.0 / cartpole_step(20_000).seconds
    for gaze_period in (None, 0.25):
        timing, frames = step_time(gaze_period, repeats)
        rate = frames / timing.seconds
        row = {
            "gaze_period [s]": 0.05 * frames,
            "step [µs]": 1e6 * timing.seconds,
            "fastest … slowest [µs]": f"{1e6 * timing.fastest:.0f} … {1e6 * timing.slowest:.0f}",
            "frames/s": rate,
            "CartPole steps / our frames": cartpole * timing.seconds / frames,
        }
        section.rows.append(row)
        if gaze_period is None:
            section.bars.append(Bar("one environment, default", rate, 8e3, "frames/s", at_least=True))
    section.notes.append(
        f"From 20 s to 34 s of `sweep`, median of {repeats} seeds. "
        f"CartPole-v1 through `gymnasium.make`: {cartpole:,.0f} steps/s."
    )
    return section


def step_time(gaze_period: float | None, repeats: int) -> tuple[Timing, int]:
    """One step's time (with its share of `info`), and its frames."""
    seconds, frames = [], 0
    for seed in range(repeats):
        env, begin = swept(100 * seed, gaze_period=gaze_period)
        inner: Any = env.unwrapped
        frames = round(inner.gaze_period / 0.05)
        end = round(34.0 / inner.gaze_period)
        actions = iter([np.array(sweep_action(step, inner.steps_per_motion)) for step in range(begin, end)])
        elapsed = timed(partial(_play, env, actions))
        seconds.append(elapsed / (end - begin - len(list(actions))))
        env.close()
    return summary(seconds), frames


def _play(env: gymnasium.Env, actions: Iterator[np.ndarray]) -> None:
    """Take actions until the belief is lost or none is left."""
    for action in actions:
        if env.step(action)[2]:
            return


def cartpole_step(steps: int) -> Timing:
    """One step of CartPole, restarts included."""
    env = gymnasium.make("CartPole-v1")
    env.reset(seed=0)

    def play() -> None:
        for step in range(steps):
            _, _, terminated, truncated, _ = env.step(step % 2)
            if terminated or truncated:
                env.reset()

    return summary([timed(play) / steps for _ in range(3)])
