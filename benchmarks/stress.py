"""`python -m benchmarks.stress`: every scenario and random legal ones, random actions, many frames: does it break?

A failure is an exception, a number that is not finite in an observation, a reward or `info`, or a process that grows.
It is printed with the scenario's fields and the seed, so that it can be repeated.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym import SCENARIOS, ActiveSLAMVectorEnv, Scenario
from activeslam_gym.config import BOUNDS
from activeslam_gym.world.room import draw_room
from benchmarks.memory import fly, resident

NUM_ENVS, FRAMES_PER_STEP = 4, 5
LEFT_ALONE = ("name", "gaze_period", "motion_criterion", "boxes", "frame_time", "estimator", "sensor", "scene")
MOST_CHANGED = 6  # fields of a random scenario that are not as in `paper`
SPREAD = 5.0  # a number is drawn within this factor of the default


def random_scenario(rng: np.random.Generator) -> Scenario:
    """A legal scenario with some fields drawn at random, for which a room exists."""
    names = [name for name in BOUNDS if name not in LEFT_ALONE]
    while True:
        chosen = rng.choice(names, rng.integers(1, MOST_CHANGED + 1), replace=False)
        try:
            drawn = Scenario(name="random", **{name: _drawn(name, getattr(Scenario(), name), rng) for name in chosen})
            draw_room(drawn, np.random.default_rng(0))
        except (ValueError, RuntimeError):  # bounds that bind fields to each other; nothing at the fiducials' distance
            continue
        if drawn != Scenario(name="random"):
            return drawn


def _drawn(name: str, default: Any, rng: np.random.Generator) -> Any:
    """A value for a field."""
    if isinstance(default, bool):
        return bool(rng.integers(2))
    if isinstance(default, str):
        return str(rng.choice(BOUNDS[name][0].words))
    if isinstance(default, tuple):
        return tuple(sorted(_drawn(name, one, rng) for one in default))
    if name.endswith("probability") or not default:
        return int(rng.integers(4)) if isinstance(default, int) else float(rng.uniform(0.0, 0.9))
    drawn = default * SPREAD ** rng.uniform(-1.0, 1.0)
    return max(int(drawn), 1) if isinstance(default, int) else float(drawn)


def run(scenario: Scenario, frames: int, seed: int) -> int:
    """Fly `NUM_ENVS` cameras for so many frames in all; the episodes that ended. Raises as `fly`."""
    step, motion, episode = (count * scenario.frame_time for count in (FRAMES_PER_STEP, 20, 350))
    env = ActiveSLAMVectorEnv(
        NUM_ENVS, scenario, gaze_period=step, motion_period=motion, duration=episode, num_threads=1
    )
    env.reset(seed=seed)
    env.action_space.seed(seed)
    episodes = fly(env, -(-frames // (NUM_ENVS * FRAMES_PER_STEP)))
    env.close()
    return episodes


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it and print the failures; the exit status: 1 if there are any."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stress", description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000, help="frames in all (default: %(default)s)")
    parser.add_argument("--scenarios", type=int, default=200, help="random ones (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the scenarios and the rooms (default: %(default)s)")
    args = parser.parse_args(arguments)
    for name, least in (("frames", 1), ("scenarios", 0), ("seed", 0)):
        if getattr(args, name) < least:
            parser.error(f"--{name}: {getattr(args, name)}; allowed: {least} or more")
    rng = np.random.default_rng(args.seed)
    scenarios = [*SCENARIOS.values(), *(random_scenario(rng) for _ in range(args.scenarios))]
    frames, begun, failures, episodes, sizes = -(-args.frames // len(scenarios)), time.monotonic(), 0, 0, []
    for i, scenario in enumerate(scenarios):
        try:
            episodes += run(scenario, frames, args.seed + NUM_ENVS * i)
        except Exception as error:  # a stress test looks for any
            failures += 1
            changed = {n: getattr(scenario, n) for n in BOUNDS if getattr(scenario, n) != getattr(Scenario(), n)}
            print(f"FAILED, seed {args.seed + NUM_ENVS * i}: {type(error).__name__}: {error}; {changed}", flush=True)
        sizes.append(resident() or 0.0)
        if (i + 1) % 20 == 0:
            done = f"{(i + 1) * frames:,} frames, {episodes} episodes, {failures} failures"
            print(f"{time.monotonic() - begun:6.0f} s: {i + 1} scenarios, {done}, {sizes[-1]:.0f} MiB", flush=True)
    growth = np.median(sizes[-len(sizes) // 5 :]) - np.median(sizes[len(sizes) // 5 : 2 * len(sizes) // 5])
    total = f"{frames * len(scenarios):,} frames, {len(scenarios)} scenarios, {episodes} episodes"
    print(f"{total}: {failures} failures; growth from the second fifth to the last {growth:.1f} MiB")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
