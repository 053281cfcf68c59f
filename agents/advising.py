"""`python -m agents live`: the paper's live system from rendered pixels. Is its advice worth following?"""

from collections.abc import Sequence
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
from agents.figures import PARTS, grid_of_panels, save_figure
from agents.study.measures import FIRST_MINUTE, LATERAL
from agents.study.verdicts import Finding, Side, judge, judged
from agents.tools.arguments import SEEDS, Figures, Pages, command_line, given, within
from agents.tools.files import alone_in, writable_folder, write_csv, write_json, write_text
from agents.tools.sections import table
from agents.tools.statistics import LEGEND, Column, Estimate, estimate

NAMES = {FOLLOW: "follows", NEVER: "random", STILL: "stays"}  # the same rooms, hands and gaze for each
CHANCE = len(LATERAL) / len(Motion)
AFTER = 2  # commands after an initialisation, in seconds
DETS = ("log2_det_camera", "log2_det_map", "log2_det_total")

MEASURES = (
    Column("log2_det_total", "log₂ \\|P\\| of everything", digits=0),
    Column("log2_det_camera", "of the camera"),
    Column("log_score", "log score, bits", digits=0),
    Column("position_error", "position error, cm", scale=100.0),
    Column("landmark_rmse", "landmark RMSE, cm", scale=100.0),
    Column("mapped", "well placed"),
    Column("position_nees", "position NEES / dof", digits=2),
    Column("lost", "lost, %", "share", 100.0, 0),
)
PAIRED = MEASURES[:6]
"""Whose differences, follower minus other in the same room, tell whether the advice is worth following."""
JUDGED: tuple[tuple[Column, Side], ...] = ((MEASURES[0], "below"), (MEASURES[2], "above"), (MEASURES[3], "below"))
"""Differences with a verdict, and the side of more information."""

Row = dict[str, Any]  # a second of a run: a line of seconds.csv
Runs = dict[str, dict[int, list[Row]]]  # habit → seed of the room → its seconds


@dataclass(frozen=True, kw_only=True)
class Args(Pages, Figures):
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

    def check(self) -> None:
        """Raises ValueError for a bad argument."""
        within(self, seed=SEEDS, jobs=(1, 4096))
        given(self, "rooms", "seconds")
        for name, (low, high) in {"rooms": (1, 10**6), "seconds": (2, 36_000)}.items():
            for value in getattr(self, name):
                if not low <= value <= high:
                    raise ValueError(f"{name}: {value!r}; allowed: {low} to {high}")
        if len(self.rooms) not in (1, len(self.seconds)):
            raise ValueError(f"rooms: {len(self.rooms)} numbers; allowed: 1 or {len(self.seconds)}, as of seconds")
        writable_folder("out", self.out)
        self.check_pages("live", "live-claims")

    @property
    def lasting(self) -> dict[int, float]:
        """Seed of each room → how long its runs last [s]."""
        counts = self.rooms * len(self.seconds) if len(self.rooms) == 1 else self.rooms
        lasts = (max(time for time, count in zip(self.seconds, counts) if j < count) for j in range(max(counts)))
        return {self.seed + j: time for j, time in enumerate(lasts)}


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    args.check()
    try:
        with alone_in(args.out):
            runs = play(args)
            told = claims(runs, args.seconds)
            text = "\n\n".join([LEGEND, told, standings(runs, args.seconds), differences(runs, args.seconds)])
            text += f"\n\n{commands(runs)}\n\n{closures(runs)}"
            write_csv(
                args.out / "seconds.csv", [row for rooms in runs.values() for run in rooms.values() for row in run]
            )
            write_json(args.out / "settings.json", {"command": command_line("live", args)})
            write_text(args.out / "live.md", text + "\n")
            if args.drawn:
                draw(runs, args.out / "figure5.png")
    except KeyboardInterrupt:
        print("Interrupted; the runs that are over are kept, and the same command goes on from them.")
        return 130
    args.publish("live", live=text, live_claims=told)
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


class Trial(NamedTuple):
    """A run; a `Job` of the store."""

    seed: int
    habit: str
    lasts: float  # [s]

    @property
    def label(self) -> str:
        return f"{self.seed}-{self.habit}"

    @property
    def group(self) -> Any:
        return self

    @property
    def key(self) -> dict[str, Any]:
        return {"live": self, "versions": package_versions(IMAGE_LIBRARIES)}


def play(args: Args) -> Runs:
    """Every habit in every room; each run is kept as soon as it is over."""
    trials = [Trial(seed, habit, lasts) for seed, lasts in args.lasting.items() for habit in HABITS]
    with closing(Store(args.out / "runs").gather(trials, play_trials, args.jobs)) as finished:
        runs = {one: rows_of(one, arrays) for one, arrays in finished}
    return {habit: {one.seed: runs[one] for one in trials if one.habit == habit} for habit in HABITS}


def play_trials(trials: Sequence[Trial]) -> list[Arrays]:
    """Play one run after the other."""
    told = [trial(*one) for one in trials]
    return [{name: np.array([getattr(now, name) for now in one]) for name in Second._fields} for one in told]


def rows_of(one: Trial, arrays: Arrays) -> list[Row]:
    """The seconds of one run."""
    columns = {name: arrays[name].tolist() for name in Second._fields if name != "log2_dets"}
    columns |= dict(zip(DETS, arrays["log2_dets"].T.tolist()))
    named = {"person": NAMES[one.habit], "room": one.seed}
    return [{**named, **dict(zip(columns, values))} for values in zip(*columns.values(), strict=True)]


# Tables ---------------------------------------------------------------------------------------------------------------


def claims(runs: Runs, times: Sequence[float]) -> str:
    """The paper's claims on its live system, each with a verdict."""
    found = []
    for time in times:
        for measure, side in JUDGED:
            for other in (NEVER, STILL):
                words = f"{measure.title}, {NAMES[FOLLOW]} − {NAMES[other]}, after {time:g} s"
                figure = difference(runs, measure, other, time)
                found.append(Finding(words, figure, judge(figure, side), measure.scale, measure.digits))
    share = estimate(sideways(runs)["after initialisations"], "median")
    words = f"% of commands that are lateral, {AFTER} s after initialisations"
    lateral = Finding(words, share, judge(share, "above", CHANCE), 100.0, 0)
    drops = []
    for part, name in (("log2_det_camera", "camera"), ("log2_det_total", "everything")):
        with_one, without = changes_by_closure(runs, part)
        words = f"change of log₂ \\|P\\| ({name}) in a second, with a closure − without"
        drops.append(judged("", words, with_one - without, "below"))
    rows = []
    for claim, where, findings in (
        ("a person who follows the advice knows more", "V", found),
        ("the commands are mostly up-down and left-right", "V, Fig. 5 b", [lateral]),
        ("entropy drops where a loop closes", "V, Fig. 5 a", drops),
    ):
        heads = [(claim, where), *[("", "")] * (len(findings) - 1)]
        rows += [[*head, one.measure, one.text, f"**{one.verdict}**"] for head, one in zip(heads, findings)]
    return table(["The paper says", "Where", "Ours, from rendered pixels", "Figure [95 %]", "Verdict"], rows)


def standings(runs: Runs, times: Sequence[float]) -> str:
    """A row for each time and habit."""
    rows = []
    for time in times:
        for habit in HABITS:
            seconds = at(runs[habit], time)
            cells = (measure.text(measure.of(seconds.values())) for measure in MEASURES)
            rows.append([f"{time:g} s, {len(seconds)} rooms", NAMES[habit], *cells])
    return table(["after", "person", *(measure.heading for measure in MEASURES)], rows)


def differences(runs: Runs, times: Sequence[float]) -> str:
    """The follower's lead over the others, in the same rooms."""
    rows = []
    for time in times:
        for other in (NEVER, STILL):
            cells = (measure.text(difference(runs, measure, other, time)) for measure in PAIRED)
            rows.append([f"{time:g} s", f"{NAMES[FOLLOW]} − {NAMES[other]}", *cells])
    return table(["after", "difference", *(measure.heading for measure in PAIRED)], rows)


def difference(runs: Runs, measure: Column, other: str, time: float) -> Estimate:
    """Of the follower from the ``other`` habit in the same rooms, at a time."""
    key, theirs = measure.key, at(runs[other], time)
    return measure.of({key: row[key] - theirs[seed][key]} for seed, row in at(runs[FOLLOW], time).items())


def commands(runs: Runs) -> str:
    """The follower's commands of the first minute, and the lateral ones after initialisations."""
    told = first_minute(runs[FOLLOW])
    text = ", ".join(f"{motion.name} {100.0 * n / max(told.sum(), 1):.0f} %" for motion, n in zip(Motion, told))
    rows = [[name, estimate(values, "median").text(100.0, 0)] for name, values in sideways(runs).items()]
    head = ["commands of the first minute", f"up, down, left or right, % (by chance {100.0 * CHANCE:.0f})"]
    return f"{table(head, rows)}\n\nAll commands of the first minute: {text}."


def closures(runs: Runs) -> str:
    """The follower's change of log2 |P| within a second, with a loop closed and without."""
    rows = []
    for part, name in zip(DETS, ("camera", "map", "everything")):
        with_one, without = changes_by_closure(runs, part)
        rows.append([name, *(estimate(values, "median").text() for values in (with_one, without, with_one - without))])
    return table(["change of log₂ \\|P\\| in a second", "with a loop closed", "without", "difference"], rows)


def at(rooms: dict[int, list[Row]], time: float) -> dict[int, Row]:
    """Seed → the last second before ``time``, of the runs that lasted until then."""
    lasting = {seed: run for seed, run in rooms.items() if run[-1]["time"] > time - 1.0}
    return {seed: [row for row in run if row["time"] <= time + 1e-6][-1] for seed, run in lasting.items()}


def first_minute(rooms: dict[int, list[Row]]) -> np.ndarray:
    """(7,) how often each motion was told in the first minute, in all rooms."""
    told = [row["command"] for run in rooms.values() for row in run if row["time"] <= FIRST_MINUTE]
    return np.bincount(told, minlength=len(Motion))


def sideways(runs: Runs) -> dict[str, list[float]]:
    """Share of the follower's commands in the first minute that are up, down, left or right, in each room."""
    shares: dict[str, list[float]] = {"after initialisations": [], "otherwise": []}
    for run in runs[FOLLOW].values():
        minute = [row for row in run if row["time"] <= FIRST_MINUTE]
        lateral, births = np.isin([row["command"] for row in minute], LATERAL), [row["births"] for row in minute]
        born = np.array([any(births[max(k - AFTER + 1, 0) : k + 1]) for k in range(len(minute))], bool)
        for name, chosen in (("after initialisations", lateral[born]), ("otherwise", lateral[~born])):
            shares[name].append(float(np.mean(chosen)) if len(chosen) else np.nan)
    return shares


def changes_by_closure(runs: Runs, part: str) -> np.ndarray:
    """(2, rooms) mean change of a ``part`` of log2 |P| in the follower's seconds with a closure, and without."""
    changes = []
    for run in runs[FOLLOW].values():
        steps, closed = np.diff([row[part] for row in run]), np.array([row["closures"] > 0 for row in run[1:]], bool)
        changes.append([float(np.mean(own)) if len(own) else np.nan for own in (steps[closed], steps[~closed])])
    return np.array(changes).T


def draw(runs: Runs, path: Path) -> None:
    """Figure 5 of the paper: (a) entropies in the first room, loops marked; (b) commands of the first minute, all."""
    figure, ((left, right),) = grid_of_panels(1, 2, (5.2, 3.4))
    run = next(iter(runs[FOLLOW].values()))
    for name, colour in PARTS.items():
        values = [row[f"log2_det_{name}"] for row in run]
        left.plot([row["time"] for row in run], values, color=colour, label=name, linewidth=1.2)
    closed = [(row["time"], row["log2_det_total"]) for row in run if row["closures"]]
    left.plot(*np.reshape(closed, (-1, 2)).T, "v", color="#E69F00", markersize=4, label="a loop closes")
    left.set(xlabel="time, s", ylabel="log₂|P|", title="(a) entropies, one room")
    left.legend(fontsize=8)
    right.bar(range(len(Motion)), first_minute(runs[FOLLOW]), color="#0072B2")
    right.set_xticks(range(len(Motion)), [motion.name.lower() for motion in Motion], rotation=40, fontsize=8)
    right.set(ylabel="commands", title="(b) commands of the first minute, all rooms")
    save_figure(figure, path)
