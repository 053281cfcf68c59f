"""`python -m agents bounds`: every kind of policy in the same rooms, between open-loop policies and upper bounds."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from activeslam_gym.config import scenario_from
from activeslam_gym.evaluation import Episode
from agents import pretrained
from agents.bounds.ceiling import ceiling
from agents.bounds.planners import BASE as GENERAL
from agents.bounds.planners import BUDGETS
from agents.compare import command as compare
from agents.figures import grid_of_panels, save_figure
from agents.task import check
from agents.tools.arguments import Figures, Pages, Rooms, first_room, given
from agents.tools.files import write_json, write_text
from agents.tools.sections import Table
from agents.tools.statistics import estimate, shares

BASE, SEQUENCE = "best-constant", "best-sequence"
ORACLE, CEILING = "oracle planner", "upper bound on its path"
PLANNERS = {f"planner, {budget} runs": f"agents.bounds.planners:{size}" for size, budget in BUDGETS.items()}
PLANNER = list(PLANNERS)[-1]
SOURCES = PLANNERS | {ORACLE: "agents.bounds.planners:oracle"}
"""Name in the table → the policy, where it is another."""
Scores = dict[str, dict[int, float]]  # policy → seed → log score gained [bit]


@dataclass(frozen=True, kw_only=True)
class Args(Rooms, Pages, Figures):
    """Bounds: open-loop, greedy and learned policies, the planner at three budgets, and upper bounds."""

    scenarios: tuple[str, ...] = ("paper", "office", "corridor", "sprint", "clusters", "corner")
    """Names of scenarios, each in rooms of its own: `seed` counts from its first, and 1 000 000 is that one."""
    greedy: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "joint-mi", "lookahead-2", "greedy-plus")
    """Greedy policies, of which the best counts."""
    learned: tuple[str, ...] = ()
    """Learned policies; those trained in the scenario, and `generalist`, if none is given."""
    episodes: int = 50
    gaze_period: float | None = None
    """Seconds between gaze commands; the scenario's if not given."""
    duration: float | None = None
    """Seconds of an episode; the scenario's if not given."""
    out: Path = Path("results/bounds")

    def __post_init__(self) -> None:
        super().__post_init__()
        given(self, "scenarios")

    def comparison(self, scenario: str) -> compare.Args:
        """The comparison in one scenario."""
        learned = self.learned or (*pretrained.trained_in(scenario), GENERAL)
        policies = (BASE, SEQUENCE, *self.greedy, *learned, *SOURCES.values())
        environment = {"scenario": scenario, "gaze_period": self.gaze_period, "duration": self.duration}
        seed = first_room(scenario, self.seed)
        return compare.part_of(self, scenario, seed, policies=policies, reference=BASE, **environment)


def main(args: Args) -> int:
    """Run what is missing, and write table and figure; the exit status, 130 when interrupted."""
    comparisons = {scenario: args.comparison(scenario) for scenario in args.scenarios}
    for one in comparisons.values():
        check(one.names, [one.environment])
    args.check_pages("bounds")
    args.prepare()
    if compare.compare_each(comparisons) is None:
        return 130
    results = {scenario: scores(one) for scenario, one in comparisons.items()}
    texts = [f"### `{scenario}`\n\n{bounds_table(found)}" for scenario, found in results.items()]
    text = "\n\n".join([*texts, *(["![bounds](images/bounds.png)"] if args.drawn else [])])
    write_text(args.out / "bounds.md", text + "\n")
    write_json(args.out / "bounds.json", {"settings": asdict(args), **results})
    args.publish("bounds", bounds=text)
    for folder in (args.out, *(page.parent for page in args.report)) if args.drawn else ():
        draw(results, folder / "images" / "bounds.png")
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


def scores(comparison: compare.Args) -> Scores:
    """The log scores of the comparison's episodes, from its store, and the upper bound on the best planner's paths."""
    called = {source: name for name, source in SOURCES.items()}
    found: Scores = {called.get(name, name): {} for name in (*comparison.names, CEILING)}
    for task in comparison.tasks():
        kept = comparison.episode_store.load(task.label, task.key)
        assert kept is not None
        run = Episode.of(kept)
        found[called.get(task.policy, task.policy)][task.seed] = float(run.log_score[-1] - run.log_score[0])
        if task.policy == SOURCES[PLANNER]:
            found[CEILING][task.seed] = ceiling(run, scenario_from(comparison.scenario))
    return found


def bounds_table(found: Mapping[str, Mapping[int, float]]) -> str:
    """A row for each policy: its log score, its lead over the best constant, and its share of the planner's."""
    header = ["policy", "log score, bits (median)", f"lead over {BASE} (IQM)", "lead (median)", "share, %", "episodes"]
    of_lead, rows = shares(found, PLANNER, BASE), []
    for name, own in found.items():
        lead = np.array([own[seed] - found[BASE][seed] for seed in own])
        score = estimate(list(own.values()), "median").text(digits=0)
        leads = estimate(lead, "IQM").text(), estimate(lead, "median").text()
        rows.append([name, score, *leads, of_lead[name].text(100.0, 0), str(len(own))])
    return Table("", header, rows).markdown()


def draw(results: Mapping[str, Mapping[str, Mapping[int, float]]], path: Path) -> Path:
    """Draw scenario → policy → seed → log score into `path`: each episode a dot, medians with their intervals.

    The first policy is at the top of a panel, with a line at its median.
    """
    height = 1.0 + 0.22 * max(len(found) for found in results.values())
    columns = min(len(results), 2)
    figure, panels = grid_of_panels(math.ceil(len(results) / columns), columns, (5.4, height))
    for axes in panels.flat[len(results) :]:
        axes.remove()
    for axes, (scenario, found) in zip(panels.flat, results.items()):
        scores = [np.array(list(of_policy.values())) for of_policy in found.values()]
        medians = [estimate(values, "median") for values in scores]
        for y, (values, median) in enumerate(zip(scores, medians)):
            axes.plot(values, np.full(len(values), y), ".", color="tab:blue", alpha=0.35, markersize=4)
            axes.plot([median.low, median.high], [y, y], color="black", linewidth=2.0)
            axes.plot(median.value, y, "d", color="black", markersize=6)
        axes.axvline(medians[0].value, color="tab:red", linewidth=0.8, linestyle="--")
        lowest, highest = min(np.quantile(values, 0.1) for values in scores), max(values.max() for values in scores)
        axes.set_xlim(lowest - 0.05 * (highest - lowest), highest + 0.05 * (highest - lowest))
        axes.set_yticks(range(len(found)), list(found), fontsize=8)
        axes.invert_yaxis()
        axes.set(title=scenario, xlabel="log score gained, bits (dots: episodes; diamonds: medians)")
    return save_figure(figure, path)
