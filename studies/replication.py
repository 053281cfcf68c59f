"""Which settings give the paper's numbers? The paper states the noise of its images, but not the rest of its filter.

    python -m studies.replication --designs 0
    python -m studies.replication --designs 128 --episodes 16 --out results/replication
    python -m studies.replication --live 64

The first command plays the scenario ``paper-2006``, whose settings an earlier search found; the second searches; the
third plays the live system of figure 5 under several readings.
Six numbers are compared: for each of the three strategies the time of the 14th landmark, and log2 |P| then. Settings of
a Sobol design, and then of Gaussian steps around the best of them, play training episodes. The loss of a number is the
distance of its rank among the episodes from the central half; that of a setting is the sum. The best settings play
fresh training episodes. `designs.json` keeps all; an interrupted search goes on. Two claims are judged beside the
numbers: (ii) initialises landmarks faster than (iii), and (iii) has the lower entropy at the same number of landmarks.
"""

import json
from argparse import ArgumentParser
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

import baselines
from activeslam_gym import Motion, Scenario
from activeslam_gym.config import SCENARIOS, TRAINING_SEED
from activeslam_gym.evaluation import TARGET
from activeslam_gym.files import written_whole
from agents.figures import grid_of_panels, save_figure
from agents.study.claims import STATED
from agents.study.conditions import HAND_HELD_SECONDS
from agents.study.measures import FIRST_MINUTE, LATERAL
from agents.tools.statistics import estimate
from baselines.policy import played

II, III = "mi-mi", "mi-fisher"
RANGES: dict[str, tuple[float, float, bool]] = {
    "linearity_threshold": (0.03, 0.2, True),
    "birth_detections": (3, 40, True),
    "gaze_horizon": (0.25, 8.0, True),
    "focal_px": (100.0, 200.0, True),
    "distortion": (0.0, 1.8e-5, False),
    "acceleration_std": (0.01, 0.5, True),
    "angular_acceleration_std": (0.1, 1.0, True),
    "noise_factor": (1.0, 4.0, True),
    "landmark_prior_scale": (1.0, 6.0, True),
}
"""Least and greatest value of each setting, and whether it is varied by its logarithm. ``noise_factor``: the process
noise that the filter assumes, over the true one."""
FIRST_SEED, FRESH_SEED = TRAINING_SEED + 200_000, TRAINING_SEED + 300_000
BATCH = 32  # episodes at a time
STEP = 0.12  # standard deviation of a step around a good setting, as a share of each range


def settings_of(share: np.ndarray) -> dict[str, float]:
    """Settings at ``share`` (9,) in [0, 1] of the `RANGES`."""
    out = {}
    for (name, (low, high, logarithmic)), at in zip(RANGES.items(), share.tolist(), strict=True):
        value = low * (high / low) ** at if logarithmic else low + at * (high - low)
        out[name] = round(value) if name == "birth_detections" else float(f"{value:.3g}")
    out["gaze_horizon"] = max(round(out["gaze_horizon"] / 0.05), 1) * 0.05
    return out


def scenario_of(settings: dict[str, float]) -> Scenario:
    """The scenario ``paper`` with these settings."""
    own = dict(settings)
    factor = own.pop("noise_factor")
    for name in ("acceleration_std", "angular_acceleration_std"):
        own[f"filter_{name}"] = factor * own[name]
    return replace(SCENARIOS["paper"], name="replication", **own)  # type: ignore[arg-type]


def numbers_of(scenario: Scenario, seeds: range) -> dict[str, np.ndarray]:
    """By strategy (2, E): the time of the 14th landmark [s], or inf, and log2 |P| then, or NaN, in each episode."""
    out = {}
    for name in STATED:
        episodes = played(partial(baselines.make, name), scenario, seeds)
        times = [(*one.landmark_times[TARGET - 1 : TARGET], np.inf)[0] for one in episodes]
        dets = [(*one.landmark_log2_det[TARGET - 1 : TARGET], np.nan)[0] for one in episodes]
        out[name] = np.array((times, dets))
    return out


def ranks_of(numbers: dict[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    """By strategy: the ranks in [0, 1] of the paper's time and log2 |P| among the episodes; NaN where none reached."""
    ranks = {}
    for name, (time, log2_det) in STATED.items():
        times, dets = numbers[name]
        dets = dets[np.isfinite(dets)]
        of_det = float((dets < log2_det).mean()) if len(dets) >= 4 else np.nan
        ranks[name] = (float((times < time).mean()), of_det)
    return ranks


def loss_of(ranks: dict[str, tuple[float, float]]) -> float:
    """Sum over the six numbers of the distance of the rank from the central half, plus a little of that from 1/2."""
    all_ranks = np.nan_to_num(np.array(list(ranks.values())).ravel(), nan=0.0)
    off = np.abs(all_ranks - 0.5)
    return float(np.maximum(off - 0.25, 0.0).sum() + 0.1 * off.sum())


def search(designs: int, episodes: int, path: Path) -> list[dict[str, Any]]:
    """All settings tried, each with its ranks and loss; half of them by a Sobol design, half around the best."""
    tried = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    sobol = qmc.Sobol(len(RANGES), seed=0).random(designs)
    while len(tried) < designs:
        k = len(tried)
        if k < designs // 2:
            share = sobol[k]
        else:
            rng, best = np.random.default_rng(k), sorted(tried, key=lambda one: one["loss"])[: max(4, k // 16)]
            start = np.array(best[int(rng.integers(len(best)))]["share"])
            share = np.clip(start + STEP * rng.standard_normal(len(start)), 0.0, 1.0)
        settings = settings_of(share)
        ranks = ranks_of(numbers_of(scenario_of(settings), range(FIRST_SEED, FIRST_SEED + episodes)))
        tried.append({"share": share.tolist(), "settings": settings, "ranks": ranks, "loss": loss_of(ranks)})
        with written_whole(path) as unfinished:
            unfinished.write_text(json.dumps(tried) + "\n", encoding="utf-8")
        print(f"{k}: loss {tried[-1]['loss']:.2f}, best {min(one['loss'] for one in tried):.2f}", flush=True)
    return tried


def draw(tried: list[dict[str, Any]], path: Path) -> None:
    """Loss over each setting, and ``paper-2006`` as a line: a setting that the numbers pin down has a narrow valley."""
    scenario = SCENARIOS["paper-2006"]
    factor = (scenario.filter_acceleration_std or scenario.acceleration_std) / scenario.acceleration_std
    figure, axes = grid_of_panels(3, 3, (3.3, 2.4), sharey=True)
    loss = [one["loss"] for one in tried]
    for ax, (name, (low, high, logarithmic)) in zip(axes.flat, RANGES.items(), strict=True):
        ax.plot([one["settings"][name] for one in tried], loss, ".", color="0.4")
        ax.axvline(factor if name == "noise_factor" else getattr(scenario, name), color="C1", linewidth=1.0)
        ax.set_xlabel(name)
        if logarithmic:
            ticks = np.geomspace(low, high, 3)
            ax.set_xscale("log")
            ax.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
            ax.minorticks_off()
    for ax in axes[:, 0]:
        ax.set_ylabel("loss")
    save_figure(figure, path, dpi=110)


LIVE_SEED = TRAINING_SEED + 400_000
_LIVE = SCENARIOS["hand-held"]
_SHARED = ("focal_px", "distortion", "linearity_threshold", "birth_detections", "landmark_prior_scale")
_FITTED: dict[str, Any] = {name: getattr(SCENARIOS["paper-2006"], name) for name in _SHARED}
LIVE_READINGS: dict[str, Scenario] = {
    "hand-held": _LIVE,
    "a map of 30": replace(_LIVE, landmark_count=30),
    "a map of 24": replace(_LIVE, landmark_count=24),
    "motion by the camera's information": replace(_LIVE, motion_criterion="mutual_information_camera"),
    "motion by the whole information": replace(_LIVE, motion_criterion="mutual_information"),
    "no negative information": replace(_LIVE, negative_information=False),
    "steps of 0.15 m": replace(_LIVE, step_length=0.15),
    "lens, initialisation and priors of paper-2006": replace(_LIVE, **_FITTED),
}
"""Readings of the live system: where the motion's criterion or the size of the map is not stated, for example."""


def report_live(episodes: int) -> None:
    """Print a row for each reading of the live system: log2 |P| after 2500 frames, landmarks, lateral commands."""
    print("| reading | lost | mapped | log2 P after 2500 frames | lateral, of all commands | of all that move |")
    for name, scenario in LIVE_READINGS.items():
        seeds = range(LIVE_SEED, LIVE_SEED + episodes)
        runs = played(partial(baselines.make, "mi-mi"), scenario, seeds, duration=HAND_HELD_SECONDS)
        alive = [one for one in runs if not one.lost]
        shares = []
        for one in runs:
            read = np.flatnonzero(one.motion_read)
            motions = one.actions[read[one.times[read] < FIRST_MINUTE], 0]
            lateral = np.isin(motions, LATERAL).mean()
            shares.append((lateral, lateral / max((motions != Motion.STAY).mean(), 1e-9)))
        log2_det = estimate([one.log2_det_total[-1] for one in alive], "median")
        mapped = np.median([len(one.landmark_times) for one in alive])
        of_all, of_moves = (estimate(share, "mean").text(100.0) for share in np.array(shares).T)
        lost = 1.0 - len(alive) / episodes
        print(f"| {name} | {lost:.0%} | {mapped:g} | {log2_det.text()} | {of_all} % | {of_moves} % |", flush=True)


def main(argv: list[str] | None = None) -> None:
    """Search, draw, and validate the best settings."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--designs", type=int, default=128, help="settings tried")
    parser.add_argument("--episodes", type=int, default=16, help="training episodes of each strategy and setting")
    parser.add_argument("--fresh", type=int, default=96, help="fresh training episodes of the three best settings")
    parser.add_argument("--out", type=Path, default=Path("results/replication"), help="folder")
    parser.add_argument("--live", type=int, default=0, help="training episodes of each reading of figure 5, instead")
    args = parser.parse_args(argv)
    if args.live:
        report_live(args.live)
        return
    report(SCENARIOS["paper-2006"], args.fresh)
    if args.designs == 0:
        return
    args.out.mkdir(parents=True, exist_ok=True)
    tried = search(args.designs, args.episodes, args.out / "designs.json")
    draw(tried, args.out / "settings.png")
    for one in sorted(tried, key=lambda one: one["loss"])[:3]:
        print(json.dumps(one["settings"]))
        report(scenario_of(one["settings"]), args.fresh)


def report(scenario: Scenario, episodes: int) -> None:
    """Print the ranks of the paper's numbers, and the quartiles of ours, in fresh training episodes."""
    parts = [range(first, min(first + BATCH, episodes)) for first in range(0, episodes, BATCH)]
    found = [numbers_of(scenario, range(FRESH_SEED + part.start, FRESH_SEED + part.stop)) for part in parts]
    numbers = {name: np.concatenate([part[name] for part in found], axis=1) for name in STATED}
    for name, (of_time, of_det) in ranks_of(numbers).items():
        times, dets = numbers[name]
        reached = dets[dets == dets] if np.any(dets == dets) else np.array([np.nan])
        quarters = [np.quantile(values, (0.25, 0.5, 0.75), method="lower") for values in (times, reached)]
        texts = [", ".join(f"{value:.1f}" for value in values) for values in quarters]
        print(
            f"{name}: 14th landmark in {np.isfinite(times).mean():.0%}, quartiles {texts[0]} s, the paper's "
            f"{STATED[name][0]:g} at rank {of_time:.2f}; log2|P| {texts[1]}, {STATED[name][1]:g} at rank {of_det:.2f}"
        )
    (ii_times, ii_dets), (iii_times, iii_dets) = numbers[II], numbers[III]
    either = np.isfinite(np.minimum(ii_times, iii_times))
    first, lower = estimate((ii_times < iii_times)[either], "share"), estimate(iii_dets - ii_dets, "median")
    print(f"(ii) is first at the 14th landmark in {first.text(100.0)} % of the episodes in which one of them is")
    print(f"log2|P| then of (iii) less that of (ii), where both are: {lower.text()} ({lower.rooms} episodes)")


if __name__ == "__main__":
    main()
