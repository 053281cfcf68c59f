"""One environment: `env.step` through `gymnasium.make`, in the middle of a sweep."""

import gymnasium
import numpy as np

from .report import Bar, Section
from .setups import END, WARM_UP, sweep, swept
from .timing import timed


def run(quick: bool) -> Section:
    """Steps per second, with CartPole's beside them."""
    section = Section("One environment")
    repeats = 2 if quick else 7
    cartpole = 1.0 / cartpole_step(20_000)
    for gaze_period in (0.05, 0.25):
        seconds = np.array([step_time(gaze_period, 100 * seed) for seed in range(repeats)])
        time, frames = np.median(seconds), round(gaze_period / 0.05)
        row = {
            "gaze_period [s]": gaze_period,
            "step [µs]": 1e6 * time,
            "fastest … slowest [µs]": f"{1e6 * seconds.min():.0f} … {1e6 * seconds.max():.0f}",
            "frames/s": frames / time,
            "CartPole steps / our frames": cartpole * time / frames,
        }
        section.rows.append(row)
        if frames == 1:
            section.bars.append(Bar("one environment, a frame a step", frames / time, 8e3, "frames/s", at_least=True))
    section.notes.append(
        f"From {WARM_UP} s to {END} s of `sweep`, median of {repeats} seeds. "
        f"CartPole-v1 through `gymnasium.make`: {cartpole:,.0f} steps/s."
    )
    return section


def step_time(gaze_period: float, seed: int) -> float:
    """One step's time, with its share of `info` [s]."""
    env = swept(seed, gaze_period)
    seconds = sweep(env, gaze_period, WARM_UP, END)
    env.close()
    return float(seconds.mean()) * gaze_period


def cartpole_step(steps: int) -> float:
    """One step of CartPole [s], resets included."""
    env = gymnasium.make("CartPole-v1")
    env.reset(seed=0)

    def play() -> None:
        for step in range(steps):
            _, _, terminated, truncated, _ = env.step(step % 2)
            if terminated or truncated:
                env.reset()

    return float(np.median([timed(play) for _ in range(3)])) / steps
