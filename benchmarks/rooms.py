"""How good the front end is where the truth is known: episodes of ``ActiveSLAMPixels-v0``, judged by ray-casting.

    python -m benchmarks.rooms --episodes 100 --seed 3000000 --out results/rooms.json

Prints, for each policy, the NEES of the pose, lost runs and wrong matches; and the noise of all matched pixels.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

import activeslam_gym  # noqa: F401  (registers the environment)
import baselines
from activeslam_gym.files import written_whole
from activeslam_gym.metrics import camera_error, nees

TIMES = (5.0, 15.0, 35.0)
"""When the NEES is told [s]."""


def episode(policy: str, seed: int, scenario: Any, seconds: float) -> tuple[dict[str, Any], list[np.ndarray]]:
    """One room: its figures, and rows (n, 6) of each frame's matches: id, error u, v [px], R uu, uv, vv [px^2]."""
    env = gymnasium.make("ActiveSLAMPixels-v0", scenario=scenario, duration=seconds)
    core: Any = env.unwrapped
    observation, _ = env.reset(seed=seed)
    chooser = baselines.make(policy, env, seed=seed) if policy == "random" else baselines.make(policy, env)
    errors, counts, honest, over, state = [], np.zeros(3, int), {}, False, None
    took = 0.0
    while not over:
        action, state = chooser.predict(observation, state)
        began = time.process_time()
        observation, _, lost, truncated, info = env.step(action)
        took += time.process_time() - began
        over = lost or truncated
        seen = core.match_errors()
        errors.append(seen)
        counts += len(seen), info["events"]["wrong_matches"], info["events"]["births"]
        if any(abs(core.time - t) < 1e-6 for t in TIMES) and not lost:
            honest[round(core.time)] = pose_nees(core)
    steps = round(core.time / core.gaze_period)
    figures = {
        "policy": policy,
        "seed": seed,
        "lost": lost,
        "time": core.time,
        "nees": honest,
        "ms": 1e3 * took / steps,
    }
    figures |= {"matches": int(counts[0]), "wrong": int(counts[1]), "births": int(counts[2])}
    figures |= {name: info[name] for name in ("entropy", "log_score", "position_error", "distinct_landmarks")}
    return figures, errors


def pose_nees(core: Any) -> float:
    """NEES of position and rotation together, over 6."""
    ends = [
        np.concatenate((x.position, x.quaternion, x.velocity, x.angular_velocity)) for x in (core.truth, core.belief)
    ]
    return nees(camera_error(*ends)[:6], core.belief.covariance[:6, :6]) / 6.0


def noise(errors: list[np.ndarray]) -> dict[str, float]:
    """Of one run's matches: rms, rms of the features' own means, correlation at lags 1, 5, 20, mean squared over R."""
    series: dict[int, list[tuple[int, np.ndarray]]] = {}
    for frame, rows in enumerate(errors):
        for one in rows:
            if np.hypot(one[1], one[2]) < 4.0:
                series.setdefault(int(one[0]), []).append((frame, one[1:]))
    total: dict[str, list[Any]] = {"square": [], "bias": [], "ratio": [], "lag1": [], "lag5": [], "lag20": []}
    for seen in series.values():
        at = {frame: one[:2] for frame, one in seen}
        total["bias"] += [np.mean(list(at.values()), axis=0) ** 2] if len(at) >= 20 else []
        total["square"] += [value**2 for value in at.values()]
        for lag in (1, 5, 20):
            total[f"lag{lag}"] += [at[f] * at[f + lag] for f in at if f + lag in at]
        for _, (u, v, a, b, c) in seen:
            total["ratio"].append((c * u * u - 2 * b * u * v + a * v * v) / (a * c - b * b) / 2.0)
    return {name: float(np.mean(values)) if values else np.nan for name, values in total.items()}


def summary(episodes: list[dict[str, Any]]) -> str:
    """The table."""
    lines = []
    for policy in dict.fromkeys(one["policy"] for one in episodes):
        own = [one for one in episodes if one["policy"] == policy]
        ratios = [
            f"{np.mean(v):.2f}" for t in TIMES if (v := [e["nees"][round(t)] for e in own if round(t) in e["nees"]])
        ]
        lost, wrong = sum(e["lost"] for e in own), sum(e["wrong"] for e in own) / sum(e["matches"] for e in own)
        lines.append(
            f"{policy}: {len(own)} rooms, NEES of the pose per dof at {'/'.join(f'{t:g}' for t in TIMES)} s "
            f"{' / '.join(ratios)}, lost {lost}, wrong matches {wrong:.2%}, "
            f"position error {100 * np.median([e['position_error'] for e in own]):.1f} cm (median), "
            f"{np.median([e['distinct_landmarks'] for e in own]):.0f} landmarks, "
            f"{np.median([e['ms'] for e in own]):.1f} ms a step"
        )
    mean = {name: np.nanmean([e["noise"][name] for e in episodes]) for name in episodes[0]["noise"]}
    rho = {lag: mean[f"lag{lag}"] / mean["square"] for lag in (1, 5, 20)}
    lines.append(
        f"noise of a matched pixel: rms {mean['square'] ** 0.5:.3f} px, of a feature's own mean "
        f"{mean['bias'] ** 0.5:.3f} px, correlation after 1, 5, 20 frames "
        f"{rho[1]:.2f}, {rho[5]:.2f}, {rho[20]:.2f}; square over R {mean['ratio']:.2f}"
    )
    return "\n".join(lines)


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rooms", description=__doc__)
    parser.add_argument("--policies", nargs="+", default=["mi-fisher", "mi-mi"])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=3_000_000, help="R was fitted on rooms from 4000000 on")
    parser.add_argument("--scenario", default="pixels", help="a name, or fields as JSON")
    parser.add_argument("--seconds", type=float, default=35.0)
    parser.add_argument("--out", type=Path, default=None, help="a JSON file of the episodes, after each of them")
    args = parser.parse_args()
    scenario = json.loads(args.scenario) if args.scenario.startswith("{") else args.scenario
    episodes = []
    for policy, seed in tqdm([(p, args.seed + j) for j in range(args.episodes) for p in args.policies], unit="room"):
        figures, errors = episode(policy, seed, scenario, args.seconds)
        episodes.append(figures | {"noise": noise(errors)})
        if args.out:
            with written_whole(args.out) as unfinished:
                unfinished.write_text(json.dumps(episodes, indent=1))
    print(summary(episodes))


if __name__ == "__main__":
    main()
