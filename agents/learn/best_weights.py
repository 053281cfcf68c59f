"""The course of a training: a progress bar, checkpoints, and the best weights in validation episodes."""

import csv
import json
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv

from activeslam_gym.config import IMAGE_SCENARIOS, benchmark_seed, fields_of
from activeslam_gym.evaluation import Store
from agents import task
from agents.learn.learner import dimensions, save_learner, weights_of
from agents.learn.recipe import CHECKPOINT, CURVE, WEIGHTS, Args, Recipe, trained_scenario
from agents.learn.weights import FLOOR, card_of, read_card, save
from agents.summary import interquartile_mean, summarise, text
from agents.tools.arguments import scenario_argument
from agents.tools.files import reading, write_json

LAST_ENTROPY = 0.1  # the entropy bonus's last value, relative to its first
REFERENCES = ("best-constant", "mi-constant", "mi-fisher")
"""An open-loop policy and two greedy strategies: a learned policy is worth its training if it beats them."""
COLUMNS = (
    "log_score_gain_median",
    "log_score_gain",
    "bits",
    "landmarks_mapped",
    "landmark_rmse",
    "position_error",
    "lost",
)


class BestWeights(BaseCallback):
    """Keeps checkpoints of a learner, and its best weights and their card.

    After the update that completes each `period` decisions, and after the last one, the deterministic policy plays the
    validation episodes of each scenario, one in each environment of ``batches``. Their mean score chooses the weights,
    and stands on the card as ``held_out_return``: the return in the reward's own unit, at least `FLOOR`, plus
    `lost_penalty_weight` - 1 times the failure penalty. Of several scenarios, each mean is divided by the number of
    estimated dimensions, relative to `paper`.
    """

    def __init__(self, args: Args, learner: Any, batches: Mapping[str, VecEnv]) -> None:
        super().__init__()
        self.args, self.learner, self.batches = args, learner, batches
        self.weights, self.learned = args.out / WEIGHTS, learner.num_timesteps  # decisions before the last update
        self.visited = _last_visit(args.out / CURVE, len(batches), -1 if args.initial else 0)
        self.bar: Any = None
        self.begun = time.monotonic() - getattr(learner, "seconds", 0.0)
        self.best: float = -math.inf
        if self.weights.exists():
            card = read_card(self.weights)
            write_json(self.weights.with_suffix(".json"), card)  # a killed process may have left none beside them
            best = card.get("held_out_return")
            self.best = self.best if best is None else float(best)

    def close(self) -> None:
        """End the bar, write the present weights where none were chosen, and the checkpoint."""
        if self.bar is not None:
            self.bar.close()
        self.learner.num_timesteps = self.learned  # from an interrupted rollout nothing was learned
        if not self.weights.exists():
            self.keep(math.nan)
        self._save()

    def seconds(self) -> float:
        """Wall-clock of training, earlier calls included [s]."""
        return time.monotonic() - self.begun

    def keep(self, held_out_return: float) -> None:
        """Write the present weights and their card."""
        chosen = not math.isnan(held_out_return)
        card = card_of(self.args.arguments(), self.learner.num_timesteps, self.seconds(), chosen)
        save(self.weights, weights_of(self.learner), card | {"held_out_return": held_out_return})

    def complete_card(self) -> None:
        """Add to the card the results in held-out episodes, if any, and print them."""
        card, scenarios = read_card(self.weights), self.args.scenarios
        if not self.args.test_episodes:
            return
        references = REFERENCES if len(scenarios) == 1 else ()
        beside = f", and of {', '.join(references)}" if references else ""
        found = {}
        for name in scenarios:
            print(f"{name}: now {self.args.test_episodes} test episodes of the kept weights{beside}:", flush=True)
            tasks = _test(self.args, name, (str(self.weights), *references), self.args.test_episodes)
            summary = summarise([episode for _, episode in task.results(tasks, Store())])
            print(f"\n{text(summary)}\n")
            figures = {who: {key: asdict(row[key]) for key in COLUMNS} for who, row in summary.policies.items()}
            own = figures.pop(str(self.weights))
            played = {"first_seed": tasks[0].seed, "episodes": own["bits"]["episodes"]}
            found[name] = {**played, **own, "references": figures}
        card["results"] = found if len(scenarios) > 1 else found[scenarios[0]]
        write_json(self.weights.with_suffix(".json"), card)

    def _on_training_start(self) -> None:
        from tqdm import tqdm

        rollout = getattr(self.model, "n_steps", 1) * self.training_env.num_envs
        left = -(-(self.args.total_steps - self.num_timesteps) // rollout) * rollout
        total = self.num_timesteps + left
        self.bar = tqdm(total=total, initial=self.num_timesteps, unit="decision", unit_scale=True, disable=None)

    def _on_rollout_start(self) -> None:
        """After an update, or at the start, where initial weights may be the best."""
        self.learned = self.num_timesteps
        if self.learned // self.args.period > self.visited // self.args.period:
            self._save()
            self._visit()
        if self.args.entropy_bonus and self.args.algorithm in ("ppo", "a2c"):
            left = max(0.0, 1.0 - self.num_timesteps / self.args.total_steps)
            self.model.ent_coef = self.args.entropy_bonus * LAST_ENTROPY ** (1.0 - left)

    def _on_step(self) -> bool:
        self.bar.update(self.training_env.num_envs)
        return True

    def _save(self) -> None:
        """Write the checkpoint, and the training's length and time to it and to the card of the kept weights."""
        self.learner.seconds = self.seconds()
        save_learner(self.learner, self.args.out / CHECKPOINT)
        if self.weights.exists():
            trained = {"steps_trained": self.learner.num_timesteps, "seconds_trained": round(self.learner.seconds, 1)}
            write_json(self.weights.with_suffix(".json"), read_card(self.weights) | trained)

    def _on_training_end(self) -> None:
        self.learned = self.num_timesteps
        if self.visited < self.learned:
            self._visit()

    def _visit(self) -> None:
        """Play the validation episodes, keep the weights if they are the best so far, and add rows to the curve."""
        means, rewards, failed = {}, [], []
        for name, batch in self.batches.items():
            returns, infos = self._validation(name, batch)
            penalties = np.array([info["reward_terms"]["lost_penalty"] for info in infos])
            means[name] = float(np.mean(np.maximum(returns, FLOOR) + (self.args.lost_penalty_weight - 1.0) * penalties))
            failed.append(float(np.mean([info["lost"] or info["log_score"] < 0.0 for info in infos])))
            score = float(interquartile_mean(np.array([info["log_score"] for info in infos])))
            self._add_to_curve(name, len(infos), score, failed[-1])
            rewards.append(float(np.mean(returns)))
            self.logger.record(f"eval/{name}/mean_reward", rewards[-1])
        several = len(means) > 1
        units = [dimensions(name) / dimensions("paper") if several else 1.0 for name in means]
        found = float(np.mean(np.array(list(means.values())) / units))
        self.logger.record("eval/mean_reward", float(np.mean(rewards)))
        self.logger.record("eval/score", found)
        self.logger.dump(self.num_timesteps)
        if better := found > self.best:
            self.best = found
            self.keep(found)
        each = ", ".join(f"{name} {mean:.0f}" for name, mean in means.items())
        message = f"score {found:.0f}{f' ({each})' if several else ''}, failures {100 * np.mean(failed):.0f} %"
        done = f"{self.num_timesteps:>9,} decisions, {self.seconds():,.0f} s"
        self.visited = self.num_timesteps
        self.bar.write(f"{done}: validation: {message}{'; kept' if better else ''}")

    def _validation(self, scenario: str, batch: VecEnv) -> tuple[list[float], list[dict[str, Any]]]:
        """Returns and last infos of the validation episodes of a scenario."""
        infos: list[dict[str, Any]] = []

        def note(local: dict[str, Any], _: dict[str, Any]) -> None:
            if local["done"]:
                infos.append(local["info"])

        batch.seed(benchmark_seed(scenario, validation=True))
        returns, _ = evaluate_policy(self.model, batch, batch.num_envs, callback=note, return_episode_rewards=True)
        return returns, infos  # type: ignore[return-value]

    def _add_to_curve(self, scenario: str, episodes: int, log_score: float, failures: float) -> None:
        """Add a row of validation to `CURVE`: the interquartile mean of the log score [bit] and the share of failures.

        The policy's own entropy [nat] is that of the last update, for learners that log it.
        """
        path, entropy = self.args.out / CURVE, self.logger.name_to_value.get("train/entropy_loss", math.nan)
        new = not path.exists()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if new:
                writer.writerow("decisions seconds scenario episodes log_score failures policy_entropy".split())
            row = self.num_timesteps, round(self.seconds()), scenario, episodes, f"{log_score:.1f}", f"{failures:.4f}"
            writer.writerow((*row, f"{-entropy:.3f}"))


def _last_visit(curve: Path, scenarios: int, none: int) -> int:
    """The decisions before the last validation in all ``scenarios``, by its rows in a ``curve``, or ``none``."""
    if not curve.exists():
        return none
    with reading(curve), curve.open(encoding="utf-8", newline="") as file:
        rows = Counter(int(row["decisions"]) for row in csv.DictReader(file))
    return max((decisions for decisions, count in rows.items() if count >= scenarios), default=none)


def check_test(args: Args) -> None:
    """Raise ValueError where test episodes could not be played at the end: a policy takes a step in each scenario."""
    if args.test_episodes:
        names = REFERENCES if len(args.scenarios) == 1 else ("stay",)
        task.check([one for scenario in args.scenarios for one in _test(args, scenario, names, 1)])


def _test(recipe: Recipe, scenario: str, policies: Sequence[str], episodes: int) -> list[task.Task]:
    """The test episodes of policies, which are of neither training, nor the choice of weights, nor a benchmark."""
    named = fields_of(trained_scenario(scenario)) if scenario in IMAGE_SCENARIOS else scenario_argument(scenario)
    given = {"scenario": named, "duration": recipe.duration}
    with closing(task.make_environment(given)) as env:
        own = recipe.decision_period / env.unwrapped.gaze_period
    if own < 1.0 or abs(own - round(own)) > 1e-6:  # the policy cannot hold its decisions in whole steps
        given["gaze_period"] = recipe.decision_period
    settings, first = json.dumps(given), benchmark_seed(scenario, validation=True) + 250_000
    return [task.Task(policy, seed, settings) for policy in policies for seed in range(first, first + episodes)]
