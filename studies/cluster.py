"""What a cluster of N cores needs for a list of episodes: a simulation of its schedule with measured times.

    python -m studies.cluster --report docs/cluster.md  # the table, and docs/images/cluster.png
    python -m studies.cluster --measure                 # plays the episodes again, for studies/cluster.json (minutes)

The simulated cluster runs `activeslam_gym.evaluation.cluster.Schedule`. A core loads kernels in its first chunk. The
calling process takes one answer after the other: a time for each chunk, and one for each episode in it.
"""

import heapq
import itertools
import json
import pickle
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.evaluation import Episode, Store
from activeslam_gym.evaluation import cluster as engine
from activeslam_gym.evaluation.store import _made
from agents.figures import grid_of_panels, save_figure
from agents.task import Task, play_tasks
from agents.tools.sections import table
from studies import Page, run

DATA = Path(__file__).with_suffix(".json")
POLICIES = ("sweep", "mi-fisher", "mi-mi", "greedy-plus", "generalist")
SCENARIOS = ("paper", "office", "corner-pixels")
CORES = (2, 16, 256, 4096)
EPISODES = (10_000, 1_000_000)
TRANSFER = 100e6  # bytes a second between machines, a tenth of 10 Gbit/s


class Job(NamedTuple):
    """An episode of the simulation."""

    group: str
    seconds: float


class Run(NamedTuple):
    """A simulated run: its wall time [s], and the time of play over cores x wall time."""

    wall: float
    efficiency: float


def simulated(times: Mapping[str, list[float]], costs: Mapping[str, float], episodes: int, cores: int) -> Run:
    """Play so many episodes, the same number of each group of ``times`` [s], drawn from its measured ones."""
    rng, each = np.random.default_rng(0), episodes // len(times)
    jobs = [(Job(name, one),) for name, own in times.items() for one in rng.choice(own, each).tolist()]
    schedule, queue = engine.Schedule(jobs), deque[tuple[float, Any]]()  # chunks that wait for a core, and since when
    now = caller = costs["connect"]  # until then the calling process is busy
    free, begun = list(range(cores)), set[int]()
    over: list[tuple[float, int, float, Any]] = []  # when a chunk is over, on which core, its time, the chunk
    while True:
        while len(queue) + len(over) < engine.AHEAD * cores and (chosen := schedule.next(cores)):
            queue.append((caller + costs["transfer"], chosen))
        while free and queue:
            core, (ready, chosen) = free.pop(), queue.popleft()
            seconds = sum(task[0].seconds for task in chosen[1]) + (0.0 if core in begun else costs["load"])
            begun.add(core)
            heapq.heappush(over, (max(now, ready) + seconds, core, seconds, chosen))
        if not over:
            break
        now, core, seconds, (group, chunk) = heapq.heappop(over)
        free.append(core)
        caller = max(caller, now) + costs["chunk"] + costs["episode"] * len(chunk)
        group.cost = min(group.cost, seconds / len(chunk))
    wall = max(now, caller)
    return Run(wall, sum(one.seconds for (one,) in jobs) / (cores * wall))


def measured(rooms: int = 6) -> dict[str, Any]:
    """Times [s] of episodes by policy and scenario, and costs of an episode and a chunk, on `--cluster local`."""
    times: dict[str, list[float]] = {}
    for scenario, policy in itertools.product(SCENARIOS, POLICIES):
        jobs = [Task(policy, seed, json.dumps({"scenario": scenario})) for seed in range(rooms + 1)]
        spent = [_seconds(partial(_made, play_tasks, [job])) for job in jobs]
        times[f"{policy}, {scenario}"] = np.round(spent[1:], 3).tolist()  # the first one loads kernels
        print(f"{policy}, {scenario}: {np.mean(spent[1:]):.2f} s", flush=True)
    (made,) = _made(play_tasks, jobs[:1])
    answer, first = pickle.dumps([made]), [(Task("mi-mi", 0),)]
    costs = {"bytes": len(answer), "transfer": len(answer) / TRANSFER, "episode": _cost_of_an_answer(jobs[0], answer)}
    costs["connect"] = _seconds(partial(_on_cluster, _nothing, [(0,)]))
    costs["chunk"] = _seconds(partial(_on_cluster, _nothing, [(i,) for i in range(200)])) / 200
    costs["load"] = _seconds(partial(_on_cluster, play_tasks, first)) - float(np.mean(times["mi-mi, paper"]))
    return {"times": times, "costs": costs}


def _seconds(call: Callable[[], Any]) -> float:
    """The time of a call [s]."""
    begun = perf_counter()
    call()
    return perf_counter() - begun


def _on_cluster(function: Callable[[Any], Any], tasks: Sequence[Any]) -> None:
    list(engine.on_cluster(function, tasks, "local", {}))


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


def table_of(data: Mapping[str, Any]) -> str:
    """A row for each number of cores, and the costs."""
    times, costs = data["times"], data["costs"]
    head, rows = ["Cores"], [[str(cores)] for cores in CORES]
    for count in EPISODES:
        of = f"{count:,} episodes".replace(",", " ")
        head += [f"Wall time, {of}", f"efficiency, %, {of}"]
        for cores, row in zip(CORES, rows):
            run = simulated(times, costs, count, cores)
            row += [time_text(run.wall), f"{100 * run.efficiency:.0f}"]
    mean = float(np.mean([np.mean(own) for own in times.values()]))
    most = 1.0 / (costs["episode"] + costs["chunk"] * mean / engine.CHUNK)
    spent = f"{1000 * costs['chunk']:.1f} ms on a chunk and {1000 * costs['episode']:.2f} ms on each episode in it"
    text = (
        f"Over {len(times)} pairs of policy and scenario, an episode takes {mean:.2f} s of a core and sends "
        f"{costs['bytes'] / 1000:.0f} kB. A core loads kernels for {costs['load']:.1f} s. The calling process spends "
        f"{spent}, so it takes at most {most:.0f} episodes a second, of {most * mean:.0f} cores: "
        "there it stops scaling."
    )
    return f"{table(head, rows)}\n\n{fill(text, 100)}"


def time_text(seconds: float) -> str:
    """A time in seconds, minutes or hours."""
    unit, name = next((one for one in ((3600, "h"), (60, "min")) if seconds >= 2 * one[0]), (1, "s"))
    return f"{seconds / unit:.1f} {name}"


def draw(data: Mapping[str, Any], path: Path) -> None:
    """Efficiency over cores for each number of episodes, and the distribution of the measured times."""
    figure, ((left, right),) = grid_of_panels(1, 2, (4.5, 3.2))
    cores = [2**k for k in range(1, 13)]
    for count in (10_000, 100_000):
        runs = [simulated(data["times"], data["costs"], count, n) for n in cores]
        left.semilogx(cores, [100 * run.efficiency for run in runs], "o-", base=2, label=f"{count:,} episodes")
    left.set(xlabel="cores", ylabel="efficiency, %", ylim=(0, 105))
    left.legend()
    right.ecdf(np.concatenate(list(data["times"].values())))
    right.set(xscale="log", xlabel="time of an episode, s", ylabel="share of episodes")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    save_figure(figure, path, dpi=110)


@dataclass(frozen=True, kw_only=True)
class Args(Page):
    """What a cluster of N cores needs for a list of episodes."""

    section = "cluster"
    measure: bool = False
    """Play the episodes again."""


def main(args: Args) -> None:
    """Measure if asked, simulate, print, and draw."""
    if args.measure:
        DATA.write_text(json.dumps(measured()) + "\n", encoding="utf-8")
    data = json.loads(DATA.read_text(encoding="utf-8"))
    args.publish(table_of(data))
    if args.report:
        draw(data, args.report.parent / "images" / "cluster.png")


if __name__ == "__main__":
    run(Args, main)
