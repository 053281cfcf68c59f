"""`python -m agents live`: the paper's live system from rendered pixels. Is its advice worth following?"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym import Motion
from activeslam_gym.live.person import FOLLOW, HABITS, NEVER, STILL
from activeslam_gym.live.trial import Second, trial
from agents.tools.arguments import SEEDS, given, within
from agents.tools.files import alone_in, writable_folder, write_csv, write_json, write_text
from agents.tools.parallel import run_all
from agents.tools.sections import page_with, provenance, put_section, table
from agents.tools.statistics import Estimate, Statistic, estimate

NAMES = {FOLLOW: "follows", NEVER: "random", STILL: "stays"}
"""The same rooms, hands and gaze for each."""
SIDEWAYS = (Motion.UP, Motion.DOWN, Motion.LEFT, Motion.RIGHT)
"""What the paper saw most of, after births."""
CHANCE = len(SIDEWAYS) / len(Motion)
FIRST_MINUTE = 60.0
"""Of the paper's figure 5 (b) [s]."""
AFTER = 2
"""Commands after a birth, in seconds."""
SECTION = "live"


class Measure(NamedTuple):
    """A column of the table."""

    title: str
    value: Callable[[Second], float]
    statistic: Statistic
    scale: float
    digits: int


MEASURES = (
    Measure("log₂ \\|P\\| of everything", lambda now: float(now.log2_dets[2]), "mean", 1.0, 0),
    Measure("log score, bits", lambda now: now.log_score, "median", 1.0, 0),
    Measure("position error, cm", lambda now: now.position_error, "median", 100.0, 1),
    Measure("position NEES / dof", lambda now: now.position_nees, "median", 1.0, 2),
    Measure("landmark RMSE, cm", lambda now: now.landmark_rmse, "median", 100.0, 1),
    Measure("well placed", lambda now: now.mapped, "mean", 1.0, 1),
    Measure("lost, %", lambda now: float(now.lost), "share", 100.0, 0),
)
PAIRED = MEASURES[:2]
"""Whose differences, follower minus other in the same room, tell whether the advice is worth it."""

Runs = dict[str, dict[int, list[Second]]]
"""Habit → room → its seconds."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Figures 4 and 5 of the paper from rendered pixels: does a person who follows the advice know more?"""

    rooms: int = 3
    """Rooms, for each way to behave."""
    seed: int = 5_000_000
    """Room j is that of seed + j."""
    seconds: tuple[float, ...] = (35.0, 167.0)
    """When it is compared; a run lasts to the last of them."""
    jobs: int = 1
    """Processes."""
    out: Path = Path("results/live")
    """Folder of the results."""
    report: tuple[Path, ...] = ()
    """Markdown files whose generated section "live" is made anew, for instance docs/live.md."""
    figures: bool = True
    """Draw figure 5 (needs matplotlib)."""

    def check(self) -> None:
        """Raises ValueError for a bad argument."""
        within(self, seed=SEEDS, jobs=(1, 4096), rooms=(1, 10**6))
        given(self, "seconds")
        for time in self.seconds:
            if not 2.0 <= time <= 36_000.0:
                raise ValueError(f"seconds: {time!r}; allowed: 2 to 36000")
        writable_folder("out", self.out)
        for page in self.report:
            page_with(page, SECTION)

    @property
    def command(self) -> str:
        """What runs this."""
        times = " ".join(f"{time:g}" for time in self.seconds)
        return f"python -m agents live --rooms {self.rooms} --seed {self.seed} --seconds {times}"


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    args.check()
    try:
        with alone_in(args.out):
            runs = play(args)
            text = report(runs, args.seconds)
            write(runs, text, args)
    except KeyboardInterrupt:
        return 130
    for page in args.report:
        put_section(page, SECTION, f"{provenance(args.command)}\n\n{text}")
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


def play(args: Args) -> Runs:
    """Every habit in every room."""
    rooms = range(args.seed, args.seed + args.rooms)
    tasks = [(seed, habit, max(args.seconds)) for seed in rooms for habit in HABITS]
    runs: Runs = {habit: {} for habit in HABITS}
    for (seed, habit, _), seconds in run_all(_play, tasks, args.jobs):
        runs[habit][seed] = seconds
    return runs


def _play(task: tuple[int, str, float]) -> list[Second]:
    return trial(*task)


# What came of it ------------------------------------------------------------------------------------------------------


def report(runs: Runs, times: Sequence[float]) -> str:
    """Everything as Markdown."""
    count = len(runs[FOLLOW])
    parts = [f"{count} rooms; [ ]: 95 % interval over rooms, bootstrap; of a share, Wilson's."]
    parts += [standings(runs, times), differences(runs, times), commands(runs), closures(runs)]
    return "\n\n".join(parts)


def standings(runs: Runs, times: Sequence[float]) -> str:
    """A row for each time and habit."""
    rows = []
    for time in times:
        for habit in HABITS:
            cells = (of(measure, runs[habit], time).text(measure.scale, measure.digits) for measure in MEASURES)
            rows.append([f"{time:g} s", NAMES[habit], *cells])
    return table(["after", "person", *(f"{one.title} ({one.statistic})" for one in MEASURES)], rows)


def differences(runs: Runs, times: Sequence[float]) -> str:
    """What the follower knows more than the others, in the same rooms."""
    rows = []
    for time in times:
        for other in (NEVER, STILL):
            row = [f"{time:g} s", f"{NAMES[FOLLOW]} − {NAMES[other]}"]
            for measure in PAIRED:
                own, others = runs[FOLLOW], runs[other]
                pairs = [at(own[seed], time, measure) - at(others[seed], time, measure) for seed in others]
                row.append(estimate(pairs, measure.statistic).text(1.0, measure.digits))
            rows.append(row)
    return table(["after", "difference", *(one.title for one in PAIRED)], rows)


def commands(runs: Runs) -> str:
    """Are they mostly up-down and left-right, after births above all? The follower's first minute."""
    shares: dict[str, list[float]] = {"after births": [], "otherwise": []}
    for seconds in runs[FOLLOW].values():
        minute = [now for now in seconds if now.time <= FIRST_MINUTE]
        born = [any(now.births for now in minute[max(k - AFTER + 1, 0) : k + 1]) for k in range(len(minute))]
        for name, wanted in (("after births", True), ("otherwise", False)):
            chosen = [now.command in SIDEWAYS for now, fresh in zip(minute, born) if fresh is wanted]
            shares[name].append(float(np.mean(chosen)) if chosen else np.nan)
    told = first_minute(runs[FOLLOW])
    text = ", ".join(f"{motion.name} {100.0 * n / max(told.sum(), 1):.0f} %" for motion, n in zip(Motion, told))
    rows = [[name, estimate(values, "mean").text(100.0, 0)] for name, values in shares.items()]
    head = ["commands of the first minute", f"up, down, left or right, % (by chance {100.0 * CHANCE:.0f})"]
    return f"{table(head, rows)}\n\nAll commands of the first minute: {text}."


def first_minute(rooms: dict[int, list[Second]]) -> np.ndarray:
    """(7,) how often each motion was told in the first minute, in all rooms."""
    told = [now.command for seconds in rooms.values() for now in seconds if now.time <= FIRST_MINUTE]
    return np.bincount(told, minlength=len(Motion))


def closures(runs: Runs) -> str:
    """Does the entropy drop where a loop closes? Change of log2 |P| within the second, follower."""
    rows = []
    for part, name in enumerate(("camera", "map", "everything")):
        changes: dict[bool, list[float]] = {True: [], False: []}
        for seconds in runs[FOLLOW].values():
            steps = np.diff([now.log2_dets[part] for now in seconds])
            closed = np.array([now.closures > 0 for now in seconds[1:]])
            for which in changes:
                own = steps[closed == which]
                changes[which].append(float(np.mean(own)) if len(own) else np.nan)
        difference = np.array(changes[True]) - np.array(changes[False])
        rows.append(
            [name, *(estimate(values, "mean").text() for values in (changes[True], changes[False], difference))]
        )
    return table(["change of log₂ \\|P\\| in a second", "with a loop closed", "without", "difference"], rows)


def of(measure: Measure, rooms: dict[int, list[Second]], time: float) -> Estimate:
    """A measure over rooms, at a time."""
    return estimate([at(seconds, time, measure) for seconds in rooms.values()], measure.statistic)


def at(seconds: Sequence[Second], time: float, measure: Measure) -> float:
    """A measure at the last second before ``time``."""
    return measure.value([now for now in seconds if now.time <= time + 1e-6][-1])


# Files ----------------------------------------------------------------------------------------------------------------


def write(runs: Runs, text: str, args: Args) -> None:
    """Everything into `args.out`."""
    rows = [
        row(habit, seed, now) for habit, rooms in runs.items() for seed, seconds in rooms.items() for now in seconds
    ]
    write_csv(args.out / "seconds.csv", rows)
    write_json(args.out / "settings.json", {"command": args.command})
    write_text(args.out / "live.md", text + "\n")
    if args.figures:
        draw(runs, args.out / "figure5.png")


def row(habit: str, seed: int, now: Second) -> dict[str, Any]:
    """A line of seconds.csv."""
    dets = dict(zip(("log2_det_camera", "log2_det_map", "log2_det_total"), now.log2_dets.tolist()))
    rest = {name: value for name, value in now._asdict().items() if name != "log2_dets"}
    return {"person": NAMES[habit], "room": seed, **rest, **dets}


def draw(runs: Runs, path: Path) -> None:
    """Figure 5 of the paper: (a) entropies in the first room, loops marked; (b) commands of the first minute, all."""
    from agents.figures import grid_of_panels, save_figure

    figure, grid = grid_of_panels(1, 2, (5.2, 3.4))
    left, right = grid[0]
    seconds = next(iter(runs[FOLLOW].values()))
    times, dets = np.array([now.time for now in seconds]), np.array([now.log2_dets for now in seconds])
    for part, (name, colour) in enumerate((("camera", "#D55E00"), ("map", "#56B4E9"), ("total", "#0072B2"))):
        left.plot(times, dets[:, part], color=colour, label=name, linewidth=1.2)
    closed = np.array([now.closures > 0 for now in seconds])
    left.plot(times[closed], dets[closed, 2], "v", color="#E69F00", markersize=4, label="a loop closes")
    left.set(xlabel="time, s", ylabel="log₂|P|", title="(a) entropies, one room")
    left.legend(fontsize=8)
    right.bar(range(len(Motion)), first_minute(runs[FOLLOW]), color="#0072B2")
    right.set_xticks(range(len(Motion)), [motion.name.lower() for motion in Motion], rotation=40, fontsize=8)
    right.set(ylabel="commands", title="(b) commands of the first minute, all rooms")
    save_figure(figure, path)
