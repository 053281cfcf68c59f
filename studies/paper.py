"""The claims and figures of the paper (Active Control for Single Camera SLAM, ICRA 2006), in our episodes.

    python -m studies.paper --episodes 100 --report docs/paper.md

Plays its three strategies in `paper` and `paper-2006`, variants that single claims need, and the live system
(`hand-held`), and prints a table. ``--report`` also draws the paper's figures 2, 3 and 5 into `images/paper`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from activeslam_gym import Motion
from activeslam_gym.evaluation import Episode
from agents import figures
from agents.summary import aggregate
from agents.tools.arguments import within
from agents.tools.sections import table
from studies import Study, measures, run, settings_of, tasks
from studies.measures import CHANCE, LATERAL, MINUTE, at_target, noted, share, unless_lost

STRATEGIES = {"(i)": "mi-constant", "(ii)": "mi-mi", "(iii)": "mi-fisher"}
CONDITIONS: dict[str, tuple[str, str, float, tuple[type, ...]]] = {  # policy, scenario, duration [s], measures
    **{name: (policy, "paper", 35.0, (measures.Loops,)) for name, policy in STRATEGIES.items()},
    **{f"{name} 2006": (policy, "paper-2006", 35.0, ()) for name, policy in STRATEGIES.items()},
    "fisher": ("fisher-fisher", "paper", 35.0, ()),
    "alone": ("mi-fisher", "paper", 35.0, (measures.WithoutExpected,)),
    "live": ("mi-mi", "hand-held", 167.0, ()),  # 2500 frames
}
STATED = {"(i)": (19.0, -530.0), "(ii)": (18.0, -550.0), "(iii)": (30.0, -610.0)}  # 14th landmark [s], log2 |P| then
FEWEST = 10  # episodes for a verdict
HEADER = ("The paper says", "Our measure", "Median [95 %]", "Episodes", "Verdict")
Runs = Mapping[str, Sequence[Episode]]


def row(words: str, measure: str, values: np.ndarray, above: bool, bound: float = 0.0) -> list[str]:
    """A claim: the median over episodes, and whether its whole interval is on the claimed side of the bound."""
    figure = aggregate(values, "median")
    verdict = "**holds**" if (figure.low > bound) == above else "**does not hold**"
    if figure.episodes < FEWEST or figure.low <= bound <= figure.high:
        verdict = "too few episodes" if figure.episodes < FEWEST else "not significant"
    return [words, measure, figure.text(1.0, 2 if abs(figure.value) < 10.0 else 1), str(figure.episodes), verdict]


def number(words: str, measure: str, values: np.ndarray, stated: float) -> list[str]:
    """A number that the paper states of one run, and its rank among the episodes, 0 to 1."""
    figure, lower = aggregate(values, "median"), np.count_nonzero(values < stated)
    rank = f"rank {lower / figure.episodes:.2f}" if figure.episodes else "–"
    return [words.format(f"{stated:g}".replace("-", "−")), measure, figure.text(), str(figure.episodes), rank]


def claims(runs: Runs) -> Iterator[list[str]]:
    """A row for each claim."""
    time = {name: at_target(own, "landmark_times", own[0].times[-1]) for name, own in runs.items()}
    det = {name: at_target(own, "landmark_log2_det", np.nan) for name, own in runs.items()}
    end = {name: unless_lost(own, lambda one: one.log2_det_total[-1]) for name, own in runs.items()}
    rms = {name: unless_lost(own, measures.orientation_rms) for name, own in runs.items()}
    fiducials, closures = ({name: noted(runs[name], note) for name in STRATEGIES} for note in ("fiducials", "closure"))
    for words, measure, values, above in (
        ("{} maps landmarks faster than (iii)", "14th landmark [s]", time, True),
        ("at the 14th landmark (iii) has lower entropy than {}", "log₂|P|", det, False),
        ("(iii) needs more time than {} to reduce entropy", "log₂|P| at the end", end, True),
        ("(iii) estimates orientation better than {}", "RMS error [°]", rms, False),
        ("(iii) revisits the fiducials more than {}", "matched in a frame", fiducials, True),
        ("(iii) closes loops sooner than {}", "first closure [s]", closures, False),
    ):
        for name in ("(i)", "(ii)"):
            yield row(words.format(name), f"{measure}, (iii) − {name}", values["(iii)"] - values[name], above)
    for name in STRATEGIES:
        measure = f"position, {name} [%], over 90; 95.4 of a Gaussian"
        yield row("errors stay within 2σ", measure, measures.within(runs[name]), True, 90.0)
    yield row("entropy drops where a loop closes", "camera's log₂|P|, (i)", noted(runs["(i)"], "drop"), False)
    still, moving = share(runs["alone"], [Motion.STAY]), share(runs["(iii)"], [Motion.STAY])
    yield row("without expected landmarks the best motion is always `stay`", "(iii) [%]", still, True, 95.0)
    yield row("expected landmarks keep the camera moving", "less `stay`, (iii) [%]", still - moving, True)
    closer = measures.nearest(runs["fisher"]) - measures.nearest(runs["(iii)"])
    yield row("Fisher information drives the camera onto landmarks", "distance to the nearest [m]", closer, False)
    after, live = share(runs["(ii)"], LATERAL, after="initialised"), share(runs["live"], LATERAL, until=MINUTE)
    yield row("after new features come lateral motions", "(ii) [%], by chance 57", after, True, CHANCE)
    yield row("live commands are mostly lateral", "first minute [%], by chance 57", live, True, CHANCE)
    yield number("live, log₂|P| falls to {} in 2500 frames", "log₂|P|", end["live"], -900.0)
    for name, (seconds, log2_det) in STATED.items():
        yield number(f"{name} maps 14 landmarks in {{}} s", "`paper-2006` [s]", time[f"{name} 2006"], seconds)
        yield number("log₂|P| is then {}", f"`paper-2006`, {name}", det[f"{name} 2006"], log2_det)


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """The claims and figures of the paper in our episodes."""

    section = "paper"
    seed: int = 1_000_000
    """Seed of the first episode."""
    seconds: float = 167.0
    """Longest duration of an episode in seconds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, seconds=(0.05, 1e6))


def play(args: Args) -> tuple[Runs, Runs]:
    """The episodes of every condition; and those to draw, of median log score, whole."""
    groups = {
        name: tasks(
            policy, settings_of(scenario, {"duration": min(lasts, args.seconds)}), args.seed, args.episodes, *taken
        )
        for name, (policy, scenario, lasts, taken) in CONDITIONS.items()
    }
    runs = args.played(groups)
    drawn = dict.fromkeys(STRATEGIES, measures.middle([runs[name] for name in STRATEGIES]))
    drawn["live"] = measures.middle([runs["live"]])
    return runs, args.played({name: [replace(groups[name][k], whole=True)] for name, k in drawn.items()})


def draw(runs: Runs, drawn: Runs, folder: Path) -> None:
    """Figures 2, 3 and 5: the drawn episodes, and the mean and the central 80 % of all."""
    rest = {name: [one for one in runs[name] if one.seed != drawn[name][0].seed] for name in drawn}
    shown = {f"{name} {policy}": [*drawn[name], *rest[name]] for name, policy in STRATEGIES.items()}
    pictures = {"maps": figures.maps(shown), "entropies": figures.entropies(shown), "errors": figures.errors(shown)}
    for axes, stated in zip(pictures["entropies"].axes, STATED.values()):
        axes.plot(*stated, "kx", markersize=9)
    pictures["live"] = figures.live(drawn["live"][0], runs["live"], MINUTE)
    for name, figure in pictures.items():
        figures.save_figure(figure, folder / f"{name}.png", dpi=80)


def main(args: Args) -> None:
    """Play, print the table, and regenerate the page."""
    runs, drawn = play(args)
    for page in args.report:
        draw(runs, drawn, page.parent / "images" / "paper")
    args.publish(table(HEADER, list(claims(runs))))


if __name__ == "__main__":
    run(Args, main)
