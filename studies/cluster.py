"""What a cluster of N cores needs for a list of episodes: a simulation of its schedule with measured times.

    python -m studies.cluster --report docs/cluster.md  # the table, and docs/images/cluster.png
    python -m studies.cluster --measure                 # plays the episodes again, for studies/cluster.json (minutes)

The simulated cluster runs `activeslam_gym.evaluation.cluster.Schedule`. A core loads kernels in its first chunk. The
calling process takes one answer after the other: a time for each chunk, and one for each episode in it.
"""

import argparse
import heapq
import json
import pickle
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.evaluation import Episode, Store
from activeslam_gym.evaluation import cluster as engine
from activeslam_gym.evaluation.store import _made
from agents.task import Task, play_tasks
from agents.tools.sections import table
from studies import publish, run

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
    """A simulated run."""

    wall: float  # [s]
    efficiency: float  # time of play over cores x wall
    caller: float  # share of the wall time in which the calling process is busy


def simulated(times: Mapping[str, list[float]], costs: Mapping[str, float], episodes: int, cores: int) -> Run:
    """Play so many episodes, the same number of each group of ``times`` [s], drawn from its measured ones."""
    rng, each = np.random.default_rng(0), episodes // len(times)
    drawn = {name: rng.choice(own, each).tolist() for name, own in times.items()}
    jobs = [(Job(name, seconds),) for name, own in drawn.items() for seconds in own]
    schedule, now, caller, busy = engine.Schedule(jobs), 0.0, costs["connect"], 0.0
    queues: list[deque] = [deque() for _ in range(cores)]  # chunks on their way to each core: from when, of what group
    over: list[tuple[float, int, float, Any]] = []  # when a chunk is over, on which core, its time, the chunk
    idle, first = set(range(cores)), set(range(cores))

    def send(core: int, after: float) -> None:
        chosen: Any = schedule.next(cores)
        if chosen:
            queues[core].append((after + costs["transfer"], chosen))

    def begin(core: int, now: float) -> None:
        idle.discard(core)
        ready, (group, chunk) = queues[core].popleft()
        seconds = sum(task[0].seconds for task in chunk) + (costs["load"] if core in first else 0.0)
        first.discard(core)
        heapq.heappush(over, (max(now, ready) + seconds, core, seconds, (group, chunk)))

    for core in list(range(cores)) * engine.AHEAD:
        send(core, caller)
    for core in range(cores):
        if queues[core]:
            begin(core, caller)
    while over:
        now, core, seconds, (group, chunk) = heapq.heappop(over)
        spent = costs["chunk"] + costs["episode"] * len(chunk)
        caller, busy = max(caller, now) + spent, busy + spent
        group.cost = min(group.cost, seconds / len(chunk))
        send(core, caller)
        if queues[core]:
            begin(core, now)
    wall = max(now, caller)
    return Run(wall, sum(map(sum, drawn.values())) / (cores * wall), busy / wall)


def measured(rooms: int = 6) -> dict[str, Any]:
    """Times [s] of episodes by policy and scenario, and costs of an episode and a chunk, on `--cluster local`."""
    import ray

    times: dict[str, list[float]] = {}
    for scenario in SCENARIOS:
        for policy in POLICIES:
            jobs = [Task(policy, seed, json.dumps({"scenario": scenario})) for seed in range(rooms + 1)]
            spent = []
            for job in jobs:
                begun = perf_counter()
                (made,) = _made(play_tasks, [job])
                spent.append(perf_counter() - begun)
            times[f"{policy}, {scenario}"] = spent[1:]  # the first one loads kernels
            print(f"{policy}, {scenario}: {np.mean(spent[1:]):.2f} s", flush=True)
    costs = {"bytes": len(pickle.dumps([made])), "episode": _cost_of_an_answer(job, made)}
    begun = perf_counter()
    list(engine.on_cluster(_nothing, [(0,)], "local"))
    costs["connect"] = perf_counter() - begun
    for count in (1, 200):
        begun = perf_counter()
        list(engine.on_cluster(_nothing, [(i,) for i in range(count)], "local"))
        costs["chunk"] = (perf_counter() - begun) / count
    load = [Task("mi-mi", seed, json.dumps({"scenario": "paper"})) for seed in range(1)]
    begun = perf_counter()
    list(engine.on_cluster(play_tasks, [(one,) for one in load], "local"))
    costs["load"] = perf_counter() - begun - float(np.mean(times["mi-mi, paper"]))
    costs["transfer"] = costs["bytes"] / TRANSFER
    ray.shutdown()
    return {"times": {name: np.round(own, 3).tolist() for name, own in times.items()}, "costs": costs}


def _nothing(task: Any) -> None:
    """A task that takes no time."""


def _cost_of_an_answer(job: Task, made: Any, count: int = 100) -> float:
    """Time of the calling process for an episode: it is taken out of the answer, written, and looked at [s]."""
    arrays, packed = made
    with TemporaryDirectory() as folder:
        store = Store(Path(folder))
        answer = pickle.dumps([made])
        begun = perf_counter()
        for i in range(count):
            pickle.loads(answer)
            store._write(f"{i}", job.key, packed)
            Episode.of(arrays)
        return (perf_counter() - begun) / count


def table_of(data: Mapping[str, Any]) -> str:
    """A row for each number of cores, and the costs."""
    times, costs = data["times"], data["costs"]
    head = (
        "Cores",
        *(f"{part}, {told_count(count)} episodes" for count in EPISODES for part in ("Wall time", "efficiency, %")),
    )
    rows = []
    for cores in CORES:
        runs = [simulated(times, costs, count, cores) for count in EPISODES]
        rows.append([str(cores), *(cell for run in runs for cell in (told(run.wall), f"{100 * run.efficiency:.0f}"))])
    mean = float(np.mean([np.mean(own) for own in times.values()]))
    most = 1.0 / (costs["episode"] + costs["chunk"] * mean / engine.CHUNK)
    pairs, answer = len(times), f"{costs['bytes'] / 1000:.0f} kB"
    spent = f"{1000 * costs['chunk']:.1f} ms on a chunk and {1000 * costs['episode']:.2f} ms on each episode in it"
    text = (
        f"Over {pairs} pairs of policy and scenario, an episode takes {mean:.2f} s of a core and sends {answer}. "
        f"A core loads kernels for {costs['load']:.1f} s. The calling process spends {spent}, so it takes at most "
        f"{most:.0f} episodes a second, of {most * mean:.0f} cores: there it stops scaling."
    )
    return f"{table(head, rows)}\n\n{text}"


def told_count(count: int) -> str:
    """A number with spaces between thousands."""
    return f"{count:,}".replace(",", " ")


def told(seconds: float) -> str:
    """A time in seconds, minutes or hours."""
    unit, name = next((one for one in ((3600, "h"), (60, "min")) if seconds >= 2 * one[0]), (1, "s"))
    return f"{seconds / unit:.1f} {name}"


def draw(data: Mapping[str, Any], path: Path) -> None:
    """Efficiency over cores for each number of episodes, and the distribution of the measured times."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    cores = [2**k for k in range(1, 13)]
    for count in (10_000, 100_000):
        runs = [simulated(data["times"], data["costs"], count, n) for n in cores]
        left.semilogx(cores, [100 * run.efficiency for run in runs], "o-", base=2, label=f"{count:,} episodes")
    left.set(xlabel="cores", ylabel="efficiency, %", ylim=(0, 105))
    left.legend()
    seconds = np.sort(np.concatenate(list(data["times"].values())))
    right.step(seconds, np.arange(1, len(seconds) + 1) / len(seconds), where="post")
    right.set(xscale="log", xlabel="time of an episode, s", ylabel="share of episodes", ylim=(0, 1))
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure if asked, simulate, print, and draw."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--measure", action="store_true", help="play the episodes again")
    made.add_argument("--report", type=Path, help="the page whose generated section and figure are made")
    args = made.parse_args(arguments)
    if args.measure:
        DATA.write_text(json.dumps(measured()) + "\n", encoding="utf-8")
    data = json.loads(DATA.read_text(encoding="utf-8"))
    publish(args.report, "cluster", table_of(data), "python -m studies.cluster --report docs/cluster.md")
    if args.report:
        draw(data, args.report.parent / "images" / "cluster.png")


if __name__ == "__main__":
    run(main)
