"""`python -m agents live`: the paper's live system from rendered pixels. Is its advice worth following?"""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym import Motion
from activeslam_gym.evaluation import Store
from activeslam_gym.evaluation.code import IMAGE_LIBRARIES, package_versions
from activeslam_gym.evaluation.store import Arrays
from activeslam_gym.live.person import FOLLOW, HABITS, NEVER, STILL
from activeslam_gym.live.trial import Second, trial
from agents.study.measures import FIRST_MINUTE, LATERAL
from agents.study.verdicts import Finding, Side, judge, judged
from agents.tools.arguments import SEEDS, command_line, given, within
from agents.tools.files import alone_in, writable_folder, write_csv, write_json, write_text
from agents.tools.sections import page_with, provenance, put_section, table
from agents.tools.statistics import LEGEND, Estimate, Statistic, estimate

NAMES = {FOLLOW: "follows", NEVER: "random", STILL: "stays"}
"""The same rooms, hands and gaze for each."""
CHANCE = len(LATERAL) / len(Motion)
AFTER = 2
"""Commands after a birth, in seconds."""
SECTION, CLAIMS = "live", "live-claims"
"""Of a page: everything, and the verdicts alone."""


class Measure(NamedTuple):
    """A column of the table."""

    title: str
    value: Callable[[Second], float]
    statistic: Statistic
    scale: float
    digits: int


MEASURES = (
    Measure("log₂ \\|P\\| of everything", lambda now: float(now.log2_dets[2]), "median", 1.0, 0),
    Measure("of the camera", lambda now: float(now.log2_dets[0]), "median", 1.0, 1),
    Measure("log score, bits", lambda now: now.log_score, "median", 1.0, 0),
    Measure("position error, cm", lambda now: now.position_error, "median", 100.0, 1),
    Measure("landmark RMSE, cm", lambda now: now.landmark_rmse, "median", 100.0, 1),
    Measure("well placed", lambda now: now.mapped, "median", 1.0, 1),
    Measure("position NEES / dof", lambda now: now.position_nees, "median", 1.0, 2),
    Measure("lost, %", lambda now: float(now.lost), "share", 100.0, 0),
)
PAIRED = MEASURES[:6]
"""Whose differences, follower minus other in the same room, tell whether the advice is worth it."""
JUDGED: tuple[tuple[Measure, Side], ...] = ((MEASURES[0], "below"), (MEASURES[2], "above"), (MEASURES[3], "below"))
"""What is judged of that, and the side on which it is knowing more."""

Runs = dict[str, dict[int, list[Second]]]
"""Habit → room → its seconds."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Figures 4 and 5 of the paper from rendered pixels: does a person who follows the advice know more?"""

    rooms: tuple[int, ...] = (3,)
    """Rooms, for each way to behave; one number for each of ``seconds``, or the same for all."""
    seed: int = 5_000_000
    """Room j is that of seed + j."""
    seconds: tuple[float, ...] = (35.0, 167.0)
    """When it is compared; a run lasts to the last of them that has its room."""
    jobs: int = 1
    """Processes."""
    out: Path = Path("results/live")
    """Folder of the results; runs that it holds of the same code are not made again."""
    report: tuple[Path, ...] = ()
    """Markdown files whose generated sections "live" (docs/live.md) and "live-claims" (the study) are made anew."""
    figures: bool = True
    """Draw figure 5 (needs matplotlib)."""

    def check(self) -> None:
        """Raises ValueError for a bad argument."""
        within(self, seed=SEEDS, jobs=(1, 4096))
        given(self, "rooms", "seconds")
        for count in self.rooms:
            if not 1 <= count <= 10**6:
                raise ValueError(f"rooms: {count!r}; allowed: 1 to 1000000")
        if len(self.rooms) not in (1, len(self.seconds)):
            raise ValueError(f"rooms: {len(self.rooms)} numbers; allowed: 1 or {len(self.seconds)}, as of seconds")
        for time in self.seconds:
            if not 2.0 <= time <= 36_000.0:
                raise ValueError(f"seconds: {time!r}; allowed: 2 to 36000")
        writable_folder("out", self.out)
        for page in self.report:
            page_with(page, SECTION, CLAIMS)

    @property
    def lasting(self) -> dict[int, float]:
        """Seed of each room → how long its runs last [s]."""
        counts = self.rooms * len(self.seconds) if len(self.rooms) == 1 else self.rooms
        return {
            self.seed + j: max(time for time, count in zip(self.seconds, counts) if j < count)
            for j in range(max(counts))
        }


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    args.check()
    try:
        with alone_in(args.out):
            runs = play(args)
            text = report(runs, args.seconds)
            write(runs, text, args)
    except KeyboardInterrupt:
        print("Interrupted; the runs that are over are kept, and the same command goes on from them.")
        return 130
    for page in args.report:
        put_section(page, SECTION, f"{provenance(command_line('live', args))}\n\n{text}")
        put_section(page, CLAIMS, f"{provenance(command_line('live', args))}\n\n{claims(runs, args.seconds)}")
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


def play(args: Args) -> Runs:
    """Every habit in every room; each run is kept as soon as it is over."""
    tasks = [Task(seed, habit, lasts) for seed, lasts in args.lasting.items() for habit in HABITS]
    with closing(Store(args.out / "runs").gather(tasks, play_tasks, args.jobs)) as finished:
        runs = {task: seconds_of(arrays) for task, arrays in finished}
    return {habit: {task.seed: runs[task] for task in tasks if task.habit == habit} for habit in HABITS}


class Task(NamedTuple):
    """A run; a `Job` of the store."""

    seed: int
    habit: str
    lasts: float
    """[s]"""

    @property
    def label(self) -> str:
        return f"{self.seed}-{self.habit}"

    @property
    def group(self) -> Any:
        return self

    @property
    def key(self) -> dict[str, Any]:
        return {"live": self, "versions": package_versions(IMAGE_LIBRARIES)}


def play_tasks(tasks: Sequence[Task]) -> list[Arrays]:
    """Play one run after the other."""
    told = [trial(*task) for task in tasks]
    return [{name: np.array([getattr(now, name) for now in one]) for name in Second._fields} for one in told]


def seconds_of(arrays: Arrays) -> list[Second]:
    """What `play_tasks` told of one run."""
    columns = (
        list(column) if column.ndim > 1 else column.tolist() for column in (arrays[name] for name in Second._fields)
    )
    return [Second(*values) for values in zip(*columns, strict=True)]


# What came of it ------------------------------------------------------------------------------------------------------


def report(runs: Runs, times: Sequence[float]) -> str:
    """Everything as Markdown."""
    told = (claims(runs, times), standings(runs, times), differences(runs, times), commands(runs), closures(runs))
    return "\n\n".join([LEGEND, *told])


def claims(runs: Runs, times: Sequence[float]) -> str:
    """What the paper says of its live system, each with a verdict."""
    found = [
        ("", "", _lead(runs, measure, side, other, time))
        for time in times
        for measure, side in JUDGED
        for other in (NEVER, STILL)
    ]
    found[0] = ("who follows the advice knows more", "V", found[0][2])
    share = estimate(sideways(runs)["after births"], "median")
    words = f"% of commands that are lateral, {AFTER} s after births"
    lateral = Finding("", "", words, share, judge(share, "above", CHANCE), 100.0, 0)
    found.append(("the commands are mostly up-down and left-right", "V, Fig. 5 b", lateral))
    for part, name in ((0, "camera"), (2, "everything")):
        with_one, without = changes_by_closure(runs, part)
        words = f"change of log₂ \\|P\\| ({name}) in a second, with a closure − without"
        found.append(("", "", judged("", words, with_one - without, "below")))
    found[-2] = ("entropy drops where a loop closes", "V, Fig. 5 a", found[-2][2])
    rows = [[claim, where, one.measure, one.text, f"**{one.verdict}**"] for claim, where, one in found]
    return table(["The paper says", "Where", "Ours, from rendered pixels", "Figure [95 %]", "Verdict"], rows)


def _lead(runs: Runs, measure: Measure, side: Side, other: str, time: float) -> Finding:
    """Of the follower over the ``other`` habit in the same rooms."""
    figure = difference(runs, measure, other, time)
    words = f"{measure.title}, {NAMES[FOLLOW]} − {NAMES[other]}, after {time:g} s"
    return Finding("", "", words, figure, judge(figure, side), measure.scale, measure.digits)


def standings(runs: Runs, times: Sequence[float]) -> str:
    """A row for each time and habit."""
    rows = []
    for time in times:
        for habit in HABITS:
            rooms = lasting(runs[habit], time)
            cells = (of(measure, rooms, time).text(measure.scale, measure.digits) for measure in MEASURES)
            rows.append([f"{time:g} s, {len(rooms)} rooms", NAMES[habit], *cells])
    return table(["after", "person", *(f"{one.title} ({one.statistic})" for one in MEASURES)], rows)


def differences(runs: Runs, times: Sequence[float]) -> str:
    """What the follower knows more than the others, in the same rooms."""
    rows = []
    for time in times:
        for other in (NEVER, STILL):
            cells = (difference(runs, one, other, time).text(one.scale, one.digits) for one in PAIRED)
            rows.append([f"{time:g} s", f"{NAMES[FOLLOW]} − {NAMES[other]}", *cells])
    return table(["after", "difference", *(f"{one.title} ({one.statistic})" for one in PAIRED)], rows)


def difference(runs: Runs, measure: Measure, other: str, time: float) -> Estimate:
    """Of the follower from the ``other`` habit in the same rooms, at a time."""
    own = lasting(runs[FOLLOW], time)
    return estimate([at(own[s], time, measure) - at(runs[other][s], time, measure) for s in own], measure.statistic)


def sideways(runs: Runs) -> dict[str, list[float]]:
    """Share of the follower's commands in the first minute that are up, down, left or right, in each room."""
    shares: dict[str, list[float]] = {"after births": [], "otherwise": []}
    for seconds in runs[FOLLOW].values():
        minute = [now for now in seconds if now.time <= FIRST_MINUTE]
        born = [any(now.births for now in minute[max(k - AFTER + 1, 0) : k + 1]) for k in range(len(minute))]
        for name, wanted in (("after births", True), ("otherwise", False)):
            chosen = [now.command in LATERAL for now, fresh in zip(minute, born) if fresh is wanted]
            shares[name].append(float(np.mean(chosen)) if chosen else np.nan)
    return shares


def commands(runs: Runs) -> str:
    """Are they mostly up-down and left-right, after births above all? The follower's first minute."""
    told = first_minute(runs[FOLLOW])
    text = ", ".join(f"{motion.name} {100.0 * n / max(told.sum(), 1):.0f} %" for motion, n in zip(Motion, told))
    rows = [[name, estimate(values, "median").text(100.0, 0)] for name, values in sideways(runs).items()]
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
        with_one, without = changes_by_closure(runs, part)
        rows.append([name, *(estimate(values, "median").text() for values in (with_one, without, with_one - without))])
    return table(["change of log₂ \\|P\\| in a second", "with a loop closed", "without", "difference"], rows)


def changes_by_closure(runs: Runs, part: int) -> tuple[np.ndarray, np.ndarray]:
    """(rooms,) mean change of a ``part`` of log2 |P| in the follower's seconds with a closure, and in those without."""
    changes: dict[bool, list[float]] = {True: [], False: []}
    for seconds in runs[FOLLOW].values():
        steps = np.diff([now.log2_dets[part] for now in seconds])
        closed = np.array([now.closures > 0 for now in seconds[1:]])
        for which in changes:
            own = steps[closed == which]
            changes[which].append(float(np.mean(own)) if len(own) else np.nan)
    return np.array(changes[True]), np.array(changes[False])


def lasting(rooms: dict[int, list[Second]], time: float) -> dict[int, list[Second]]:
    """Those whose run lasted until ``time``."""
    return {seed: seconds for seed, seconds in rooms.items() if seconds[-1].time > time - 1.0}


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
    write_json(args.out / "settings.json", {"command": command_line("live", args)})
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
