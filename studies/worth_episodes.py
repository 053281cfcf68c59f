"""The episodes of one row of `studies.worth`, by the packages that are imported: this one's or those of another commit.

python studies/worth_episodes.py RESULTS.csv SEED EPISODES SCENARIO:POLICY ...
"""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

BATCH = 64
EPISODE = "scenario", "policy", "seed", "lost", "log_score", "pose_nees", "landmark_nees"


def play_tasks(results: Path, tasks: list[str], seeds: range) -> None:
    """Play ``scenario:policy`` tasks, and append their episodes to the file ``results``."""
    for task in tasks:
        parts = [seeds[i : i + BATCH] for i in range(0, len(seeds), BATCH)]
        scenario, policy = task.split(":")
        rows = [one for part in parts for one in episodes(scenario, policy, part)]
        new = not results.exists()
        with open(results, "a", newline="") as file:
            writer = csv.DictWriter(file, EPISODE)
            if new:
                writer.writeheader()
            writer.writerows(rows)
        print(f"{results.stem} {task}", flush=True)


def episodes(scenario: str, policy: str, seeds: range) -> Iterator[dict[str, Any]]:
    """Play the episodes of ``seeds`` to their ends, in one batch."""
    import gymnasium as gym

    import activeslam_gym  # noqa: F401 (registers the environments)
    from agents.policies import factory

    name = "ActiveSLAMPixels-v0" if scenario.endswith("pixels") else "ActiveSLAM-v0"
    options: dict[str, Any] = {"scenario": scenario, "end_when_lost": False, "num_threads": 1}
    env: Any = gym.make_vec(name, num_envs=len(seeds), autoreset_mode="DISABLED", **options)
    chosen, state, first = factory(policy)(env, list(seeds)), None, np.ones(len(seeds), bool)
    (observation, info), over = env.reset(seed=list(seeds)), np.zeros(len(seeds), bool)
    while not over.all():
        action, state = chosen.predict(observation, state=state, episode_start=first, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        first, over = np.zeros(len(seeds), bool), terminated | truncated
    for i, seed in enumerate(seeds):
        nees = env.unwrapped.run(i).nees()
        numbers = int(info["lost"][i]), f"{info['log_score'][i]:.6g}", nees["position"], nees["landmarks"]
        yield dict(zip(EPISODE, (scenario, policy, seed, *numbers), strict=True))


if __name__ == "__main__":
    first, count = int(sys.argv[2]), int(sys.argv[3])
    play_tasks(Path(sys.argv[1]), sys.argv[4:], range(first, first + count))
