"""`python -m agents bounds`: every kind of policy in the same rooms, between what is simple and what cannot be had."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from activeslam_gym.config import scenario_from
from activeslam_gym.evaluation import Episode
from agents import pretrained
from agents.bounds.ceiling import ceiling
from agents.bounds.drawing import draw
from agents.bounds.planners import BUDGETS
from agents.bounds.share import BASE, shares
from agents.compare.command import Args as Comparison
from agents.compare.command import compare_each, tasks_of
from agents.task import check
from agents.tools.arguments import Rooms, command_line, first_room, given
from agents.tools.files import write_json, write_text
from agents.tools.sections import provenance, put_section, table
from agents.tools.statistics import estimate

SEQUENCE, GENERAL = "best-sequence", "ppo-mixed"
CLAIRVOYANT, CEILING = "clairvoyant planner", "sees everything"
PLANNERS = {f"rollout, {budget} runs": f"agents.bounds.planners:{size}" for size, budget in BUDGETS.items()}
PLANNER = list(PLANNERS)[-1]
SOURCES = PLANNERS | {CLAIRVOYANT: "agents.bounds.planners:clairvoyant"}
"""Name in the table → the policy, where it is another."""
Scores = dict[str, dict[int, float]]
"""Policy → seed → log score gained [bit]."""


@dataclass(frozen=True)
class Args(Rooms):
    """Bounds: constants, greedy and learned policies, the planner at three budgets, and what cannot be reached."""

    scenarios: tuple[str, ...] = ("paper", "office", "corridor", "sprint", "noisy", "corner")
    """Names of scenarios, each in rooms of its own: `seed` counts from its first, and 1 000 000 is that one."""
    greedy: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "joint-mi", "lookahead-2")
    """Greedy policies, of which the best counts."""
    learned: tuple[str, ...] = ()
    """Learned policies; those trained in the scenario, and `ppo-mixed`, if none is given."""
    episodes: int = 50
    """Rooms for each policy and scenario."""
    gaze_period: float = 0.25
    """Seconds between gaze commands."""
    duration: float | None = None
    """Seconds of an episode; the scenario's if not given."""
    out: Path = Path("results/bounds")
    """Folder of the results; finished episodes that it holds are not run again."""
    report: tuple[Path, ...] = ()
    """Pages whose generated section "bounds" is made anew, with its picture in `images/` beside the page."""
    figures: bool = True
    """Draw the figure (needs matplotlib)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        given(self, "scenarios")

    def names(self, scenario: str) -> tuple[str, ...]:
        """The policies that are run there, as the tables call them."""
        learned = self.learned or (*pretrained.trained_in(scenario), GENERAL)
        return (BASE, SEQUENCE, *self.greedy, *learned, *SOURCES)

    def comparison(self, scenario: str) -> Comparison:
        """The comparison in one scenario."""
        policies = tuple(SOURCES.get(name, name) for name in self.names(scenario))
        return Comparison(
            policies=policies,
            episodes=self.episodes,
            seed=first_room(scenario, self.seed),
            jobs=self.jobs,
            scenario=scenario,
            gaze_period=self.gaze_period,
            duration=self.duration,
            reference=BASE,
            out=self.out / scenario,
            store=self.store or self.out / "episodes",
            resume=True,
            figures=False,
        )


def main(args: Args) -> int:
    """Run what is missing, and write table and figure; the exit status, 130 when interrupted."""
    comparisons = {scenario: args.comparison(scenario) for scenario in args.scenarios}
    for one in comparisons.values():
        check(one.names, [one.environment])
    args.prepare("bounds")
    if compare_each(comparisons) is None:
        return 130
    write(args, {scenario: scores(one) for scenario, one in comparisons.items()})
    return 0


def scores(comparison: Comparison) -> Scores:
    """The log scores of the comparison's episodes, which are in its store, and the loose bound on the largest
    planner's paths."""
    called = {source: name for name, source in SOURCES.items()}
    settings = scenario_from(comparison.scenario)
    found: Scores = {called.get(name, name): {} for name in (*comparison.names, CEILING)}
    for task in tasks_of(comparison):
        kept = comparison.episode_store.load(task.label, task.key)
        assert kept is not None
        run = Episode.of(kept)
        found[called.get(task.policy, task.policy)][task.seed] = float(run.log_score[-1] - run.log_score[0])
        if task.policy == SOURCES[PLANNER]:
            found[CEILING][task.seed] = ceiling(run, settings)
    return found


def write(args: Args, results: Mapping[str, Scores]) -> None:
    """Everything into `args.out`, and into the pages of `args.report`."""
    texts = [f"### `{scenario}`\n\n{bounds_table(found)}" for scenario, found in results.items()]
    text = "\n\n".join([*texts, *(["![bounds](images/bounds.png)"] if args.drawn else [])])
    write_text(args.out / "bounds.md", text + "\n")
    write_json(args.out / "bounds.json", {"settings": json.loads(json.dumps(asdict(args), default=str)), **results})
    if args.drawn:
        draw(results, args.out / "images" / "bounds.png")
    for page in args.report:
        put_section(page, "bounds", f"{provenance(command_line('bounds', args))}\n\n{text}")
        if args.drawn:
            draw(results, page.parent / "images" / "bounds.png")
    print(f"\n{text}\n\nWritten to {args.out}/")


def bounds_table(found: Scores) -> str:
    """A row for each policy: its log score, its lead over the best constant, and its share of the planner's."""
    of_lead = shares(found, PLANNER, BASE)
    header = ["policy", "log score, bits (median)", f"lead over {BASE} (IQM)", "lead (median)", "share, %", "rooms"]
    rows = [
        [name, *_figures(own, found[BASE]), of_lead[name].text(100.0, 0), str(len(own))] for name, own in found.items()
    ]
    return table(header, rows, "| --- |" + " ---: |" * (len(header) - 1))


def _figures(own: Mapping[int, float], base: Mapping[int, float]) -> Sequence[str]:
    """Median, and paired lead by interquartile mean and by median."""
    lead = np.array([own[seed] - base[seed] for seed in own])
    leads = estimate(lead, "IQM"), estimate(lead, "median")
    return [estimate(list(own.values()), "median").text(digits=0), *(one.text() for one in leads)]
