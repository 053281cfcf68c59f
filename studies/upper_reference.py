"""How much is left: the best of many action sequences, searched in the true room with the true noise.

    python -m studies.upper_reference --scenarios office corner --episodes 32

For each validation episode the cross-entropy method (Rubinstein 1999) searches a sequence of decisions, one a second,
that maximises the log score on the simulator itself: same room, same noise. No policy that reads observations can know
these, so the result is a reference, not a baseline; as a search may miss better sequences, it is no bound either. The
policies play the same episodes.
"""

from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym.config import benchmark_seed
from agents.learn.recipe import trained_scenario
from agents.summary import aggregate
from agents.tools.files import write_csv
from agents.tools.sections import table
from studies import Study, run

SAMPLES, ELITE, GENERATIONS = 64, 8, 12
RATE = 0.7  # weight of a generation's elite in the new probabilities
CHOICES = 7, 3  # motions and gazes
HEADER = ("scenario", "sequences in the true room", "policy", "log score", "share of the reference")


def search(env: Any, seed: int, decisions: int) -> float:
    """The best log score gain [bit] of a sequence of so many ``decisions`` in the episode of ``seed``.

    All environments of the batch ``env`` play the same episode, each with a sequence of its own.
    """
    rng, best = np.random.default_rng(seed), -np.inf
    probabilities = [np.full((decisions, count), 1.0 / count) for count in CHOICES]
    for _ in range(GENERATIONS):
        drawn = [rng.random((env.num_envs, decisions, 1)) > np.cumsum(p, axis=1)[:, :-1] for p in probabilities]
        actions = np.stack([one.sum(axis=2) for one in drawn], axis=2)
        scores = play(env, seed, actions)
        best, elite = max(best, float(scores.max())), actions[np.argsort(-scores)[:ELITE]]
        for k, p in enumerate(probabilities):
            shares = (elite[:, :, k, None] == np.arange(CHOICES[k])).mean(axis=0)
            p += RATE * (shares - p)
    return best


def play(env: Any, seed: int, actions: np.ndarray) -> np.ndarray:
    """(B,) log score gains [bit] of the sequences ``actions`` (B, decisions, 2), all in the episode of ``seed``."""
    _, infos = env.reset(seed=[seed] * env.num_envs)
    begun = infos["log_score"].copy()
    for k in range(actions.shape[1]):
        *_, infos = env.step(actions[:, k])
    return infos["log_score"] - begun


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """The best of many action sequences in the true room, beside policies in the same episodes."""

    section = "upper_reference"
    scenarios: tuple[str, ...] = ("office", "corner")
    """Scenarios, by their names."""
    policies: tuple[str, ...] = ("generalist", "greedy-plus", "mi-mi", "best-sequence")
    """Policies that play the same episodes."""
    episodes: int = 32
    """Validation episodes of each scenario."""


def main(args: Args) -> None:
    """Search, play the policies, print the table and write ``reference.csv``."""
    rows: list[list[str]] = []
    lines: list[dict[str, Any]] = []
    for name in args.scenarios:
        scenario = trained_scenario(name)
        first, decisions = benchmark_seed(name, validation=True), round(scenario.duration)
        given: dict[str, Any] = {"autoreset_mode": "DISABLED", "gaze_period": 1.0, "end_when_lost": False}
        with closing(gym.make_vec("ActiveSLAM-v0", num_envs=SAMPLES, scenario=scenario, **given)) as env:
            found = [search(env, first + k, decisions) for k in range(args.episodes)]
        reference = aggregate(found, "IQM")
        for policy, episodes in args.in_validation(name, args.policies, False).items():
            score = aggregate([one.gain for one in episodes], "IQM")
            share = f"{score.value / reference.value:.2f}"
            rows.append([f"`{name}`", reference.text(1.0), f"`{policy}`", score.text(1.0), share])
            lines += [
                {"scenario": name, "policy": policy, "episode": one.seed, "reference": best, "score": one.gain}
                for best, one in zip(found, episodes)
            ]
    if args.out:
        write_csv(args.out / "reference.csv", lines)
    args.publish(table(HEADER, rows))


if __name__ == "__main__":
    run(Args, main)
