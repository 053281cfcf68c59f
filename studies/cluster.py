"""What the calling process of `--cluster` spends on episodes: it limits how many cores work for one command.

python -m studies.cluster --report docs/cluster.md  # the text, by studies/cluster.json
python -m studies.cluster --measure                 # measures again, with Ray (minutes)
"""

import json
import pickle
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from time import perf_counter
from typing import Any

import numpy as np
import tyro

from activeslam_gym.evaluation import Episode, Store
from activeslam_gym.evaluation.cluster import CHUNK, on_cluster
from activeslam_gym.evaluation.store import _made
from agents.task import Task, play_tasks
from studies import publish, run

DATA = Path(__file__).with_suffix(".json")
POLICIES = ("sweep", "mi-fisher", "mi-mi", "greedy-plus", "generalist")
SCENARIOS = ("paper", "office", "corner-pixels")


def measured(rooms: int = 6) -> dict[str, Any]:
    """Times [s] of episodes by policy and scenario, and costs of an episode and a chunk, on `--cluster local`."""
    times: dict[str, list[float]] = {}
    for scenario, policy in product(SCENARIOS, POLICIES):
        jobs = [Task(policy, seed, json.dumps({"scenario": scenario})) for seed in range(rooms + 1)]
        spent = [_seconds(partial(_made, play_tasks, [job])) for job in jobs]
        times[f"{policy}, {scenario}"] = np.round(spent[1:], 3).tolist()  # the first one loads kernels
        print(f"{policy}, {scenario}: {np.mean(spent[1:]):.2f} s", flush=True)
    answer, first = pickle.dumps(_made(play_tasks, jobs[:1])), [(Task("mi-mi", 0),)]
    costs = {"bytes": len(answer), "episode": _cost_of_an_answer(jobs[0], answer)}
    _seconds(partial(_on_cluster, _nothing, [(0,)]))  # connects
    costs["chunk"] = _seconds(partial(_on_cluster, _nothing, [(i,) for i in range(1600)])) * CHUNK / 1600
    costs["load"] = _seconds(partial(_on_cluster, play_tasks, first)) - float(np.mean(times["mi-mi, paper"]))
    return {"times": times, "costs": costs}


def _seconds(call: Callable[[], Any]) -> float:
    """The time of a call [s]."""
    begun = perf_counter()
    call()
    return perf_counter() - begun


def _on_cluster(function: Callable[[Any], Any], tasks: Sequence[Any]) -> None:
    list(on_cluster(function, tasks, "local", {}))


def _nothing(task: Any) -> None:
    """A task that takes no time."""


def _cost_of_an_answer(job: Task, answer: bytes, count: int = 100) -> float:
    """Time of the calling process for an episode: it is taken out of the answer, written, and looked at [s]."""
    with TemporaryDirectory() as folder:
        store, begun = Store(Path(folder)), perf_counter()
        for i in range(count):
            ((arrays, packed),) = pickle.loads(answer)
            store._write(f"{i}", job.key, packed)
            Episode.of(arrays)
        return (perf_counter() - begun) / count


def text_of(data: Mapping[str, Any]) -> str:
    """The costs, and the number of cores that they allow, in words."""
    times, costs = data["times"], data["costs"]
    mean = float(np.mean([np.mean(own) for own in times.values()]))
    most = 1.0 / (costs["episode"] + costs["chunk"] / CHUNK)
    spent = f"{1000 * costs['chunk']:.1f} ms on a chunk of {CHUNK} and {1000 * costs['episode']:.2f} ms on each episode"
    return fill(
        f"Over {len(times)} pairs of policy and scenario, an episode takes {mean:.2f} s of a core and sends "
        f"{costs['bytes'] / 1000:.0f} kB. A core loads kernels for {costs['load']:.1f} s. The calling process spends "
        f"{spent} in it, so it takes at most {most:.0f} episodes a second, of {most * mean:.0f} cores: "
        "there it stops scaling.",
        100,
    )


def main(report: Path | None = None, measure: bool = False) -> None:
    """Measure if asked, and print what the calling process of `--cluster` spends.

    Args:
        report: A page whose generated section "cluster" is made.
        measure: Play the episodes again, with Ray.
    """
    if measure:
        DATA.write_text(json.dumps(measured()) + "\n", encoding="utf-8")
    data = json.loads(DATA.read_text(encoding="utf-8"))
    publish(report, "cluster", text_of(data), "python -m studies.cluster --report docs/cluster.md")


if __name__ == "__main__":
    run(lambda: tyro.cli(main, prog="python -m studies.cluster"))
