"""The paper's claims, and the findings of our runs on each."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from agents.study import toy
from agents.study.conditions import (
    CHOICES,
    DEFAULT,
    HAND_HELD_SECONDS,
    LIVE,
    LIVE_CHOICES,
    PARTICLES_NOWHERE,
    STRATEGIES,
    Array,
    Row,
    Rows,
    at_target,
    column,
    lead_at_common_rung,
    while_alive,
)
from agents.study.verdicts import Finding, Side, judged, one_draw

STATED = {"mi-constant": (19.0, -530.0), "mi-mi": (18.0, -550.0), "mi-fisher": (30.0, -610.0)}
"""Strategy → time of the 14th landmark [s] and log₂|P| then, as the paper reads them off figure 2 d–f."""
STATED_LIVE = -900.0  # log₂|P| after 2500 frames of the live system, the end of figure 5 a's axis
CHANCE_LATERAL = 4.0 / 7.0  # share of the commands that are lateral if all seven are as likely
ALWAYS = 0.95  # a share that is called `always`
LOST_BAR = 0.05  # most runs that may be lost under `clutter`
LADDERS = {"ladder_log2_det": "unvisited counted", "ladder_visited": "visited alone"}
FISHER_MOTIONS = {DEFAULT: "trace", "eigenvalue": "largest eigenvalue", "unpropagated": "trace of horizon 0"}
"""Choice → metric of a motion by Fisher information."""
INITIALISERS = {"inverse depth": ("nowhere", DEFAULT), "particles": (PARTICLES_NOWHERE, "particles")}
"""Initialiser → choices without and with expected landmarks."""
SCENES = range(100)  # seeds of the scenes of figure 1
OWN, OTHERS = "mi-fisher", ("mi-constant", "mi-mi")


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, and our findings on it."""

    key: str
    words: str  # the paper's, shortened
    where: str  # section or figure
    findings: Callable[[Rows], Iterator[Finding]]  # the main choice of each measure first; they need not name the claim


def findings_of(rows: Rows) -> list[Finding]:
    """The findings on every claim."""
    return [replace(finding, claim=claim.key) for claim in CLAIMS for finding in claim.findings(rows)]


Lead = Callable[[list[Row], list[Row], float], Array]
"""(runs of one, runs of another, duration) → (rooms,) of one − of the other."""


def _lead(values: Callable[[list[Row], float], Array]) -> Lead:
    return lambda ours, theirs, end: values(ours, end) - values(theirs, end)


def _against(
    key: str, words: str, where: str, measure: str, lead: Lead, side: Side, digits: int = 1
) -> Iterator[Claim]:
    """The claim on (iii) minus each other strategy, under every choice; `{}` is its name in `key`, and its numeral."""
    for other in OTHERS:

        def findings(rows: Rows, other: str = other) -> Iterator[Finding]:
            for choice in (choice.name for choice in CHOICES):
                values = lead(rows[choice, OWN], rows[choice, other], rows.duration)
                yield judged(choice, f"{measure}, (iii) − {STRATEGIES[other]}", values, side, digits=digits)

        yield Claim(key.format(other), words.format(STRATEGIES[other]), where, findings)


def _runs(rows: Rows, live: Sequence[str] = LIVE_CHOICES) -> dict[str, list[Row]]:
    """Numeral → the runs of the strategy; then the runs of the live system."""
    runs = {numeral: rows[DEFAULT, strategy] for strategy, numeral in STRATEGIES.items()}
    return runs | {name: rows[name, LIVE] for name in live}


def _stated_times(rows: Rows) -> Iterator[Finding]:
    for strategy, (time, _) in STATED.items():
        times = at_target(rows[DEFAULT, strategy], "ladder_time", rows.duration)
        early, reached = int(np.sum(times <= time)), int(np.sum(times < rows.duration))
        measure = f"median time of the 14th landmark, s, {STRATEGIES[strategy]} (the paper: {time:g})"
        note = f"{_spread(times)}, {early} as early; reached in {reached} of {len(times)}"
        yield one_draw(DEFAULT, measure, times, time, note)


def _stated_entropies(rows: Rows) -> Iterator[Finding]:
    for (ladder, counted), (strategy, (_, log2_det)) in product(LADDERS.items(), STATED.items()):
        values = at_target(rows[DEFAULT, strategy], ladder)
        measure = f"median log₂\\|P\\| at the 14th landmark, {counted}, {STRATEGIES[strategy]} (paper: {log2_det:.0f})"
        note = f"{int(np.sum(~np.isnan(values)))} rooms reached it; {_spread(values)}"
        yield one_draw(DEFAULT, measure, values, log2_det, note, digits=0)


def _spread(values: Array) -> str:
    """The central 95 % of the rooms, in words."""
    if np.isnan(values).all():
        return "no room to tell"
    low, high = np.nanquantile(values, (0.025, 0.975))
    return f"central 95 % of rooms {low:.0f} … {high:.0f}"


def _consistent_errors(rows: Rows) -> Iterator[Finding]:
    forms = {
        "position_in_axis": ("% of position errors within ±0.2 m", 0.95),
        "quaternion_in_axis": ("% of quaternion errors within ±0.02", 0.95),
        "position_in_bounds": ("% of position errors within 2σ (nominal 95.4)", 0.9),
        "orientation_in_bounds": ("% of orientation errors within 2σ (nominal 95.4)", 0.9),
    }
    for (name, (measure, bound)), (numeral, runs) in product(forms.items(), _runs(rows, live=()).items()):
        yield judged(DEFAULT, f"{measure}, {numeral}", column(runs, name), "above", bound, 100.0)


def _closure_drop(rows: Rows) -> Iterator[Finding]:
    for part, (name, runs) in product(("camera", "total"), _runs(rows).items()):
        change = column(runs, f"closure_change_{part}") - column(runs, f"before_change_{part}")
        measure = f"change of log₂\\|P\\| ({part}) in the second from a closure on − before it, {name}"
        yield judged(DEFAULT, measure, change, "below")


def _homeostasis(rows: Rows) -> Iterator[Finding]:
    for (strategy, numeral), (initialiser, (without, _)) in product(STRATEGIES.items(), INITIALISERS.items()):
        measure = f"% of motions that are `stay` without expected landmarks, {numeral}"
        yield judged(initialiser, measure, column(rows[without, strategy], "stay_share"), "above", ALWAYS, 100.0)


def _less_homeostasis(rows: Rows) -> Iterator[Finding]:
    for (strategy, numeral), (initialiser, pair) in product(STRATEGIES.items(), INITIALISERS.items()):
        without, with_them = (column(rows[choice, strategy], "stay_share") for choice in pair)
        measure = f"% of motions that are `stay`, without − with expected landmarks, {numeral}"
        yield judged(initialiser, measure, without - with_them, "above", scale=100.0)


def _approach(rows: Rows) -> Iterator[Finding]:
    forms: dict[str, tuple[str, Side, float, int]] = {
        "nearest_mean": ("mean distance to the nearest point in view, m", "below", 1.0, 2),
        "fiducial_distance": ("mean distance to the fiducials, m", "below", 1.0, 2),
        "forward_share": ("% of motions that are `forward`", "above", 100.0, 1),
    }
    for (name, (measure, side, scale, digits)), (choice, metric) in product(forms.items(), FISHER_MOTIONS.items()):
        gain = column(rows[choice, "fisher-fisher"], name) - column(rows[choice, OWN], name)
        yield judged(metric, f"{measure}, Fisher − MI motion", gain, side, scale=scale, digits=digits)


def _perpendicular(rows: Rows) -> Iterator[Finding]:
    for event, (name, runs) in product(("birth", "mapping"), _runs(rows).items()):
        after, measure = column(runs, f"lateral_after_{event}"), f"% of motions that are lateral after a {event}"
        yield judged(event, f"{measure}, {name} (chance 57)", after, "above", CHANCE_LATERAL, 100.0)
        more = after - column(runs, "lateral_otherwise")
        yield judged(event, f"{measure} − otherwise, {name}", more, "above", scale=100.0)


def _live(rows: Rows) -> Iterator[Finding]:
    for name in LIVE_CHOICES:
        minute = column(rows[name, LIVE], "lateral_first_minute")
        measure = f"% of motions that are lateral in the first minute, {name} (chance 57)"
        yield judged(name, measure, minute, "above", CHANCE_LATERAL, 100.0)


def _live_entropy(rows: Rows) -> Iterator[Finding]:
    for name in LIVE_CHOICES:
        values = while_alive(rows[name, LIVE], "final_log2_det")
        measure = f"median log₂\\|P\\| after {HAND_HELD_SECONDS:g} s, {name} (the paper: about {STATED_LIVE:.0f})"
        note = f"{int(np.sum(~np.isnan(values)))} of {len(values)} runs were not lost by then"
        yield one_draw(name, measure, values, STATED_LIVE, note, digits=0)


def _clutter(rows: Rows) -> Iterator[Finding]:
    for policy in (*STRATEGIES, "sweep", "random"):
        lost = column(rows["clutter", policy], "lost")
        measure = f"% lost under `clutter`, {policy} (bar: {100 * LOST_BAR:g})"
        yield judged("clutter", measure, lost, "below", LOST_BAR, 100.0, statistic="share")


def _figure_1(rows: Rows) -> Iterator[Finding]:
    measure = "% of drawn scenes whose best move lies between landmarks 2 and 3 (more than half?)"
    for (view, half_view), (shape, isotropic) in product(toy.VIEWS.items(), toy.SHAPES.items()):
        inside = np.array([toy.lies_between(toy.drawn(seed, isotropic, half_view)) for seed in SCENES], float)
        yield judged(f"{view} with {shape}", measure, inside, "above", 0.5, 100.0, 0, "share")


def _claims() -> Iterator[Claim]:
    yield Claim("figure-1", "moving between landmarks 2 and 3 maximises the mutual information", "Fig. 1", _figure_1)
    words, measure = "{} inserts landmarks faster than (iii)", "time of the 14th landmark, s"
    reached = _lead(lambda runs, end: at_target(runs, "ladder_time", end))
    yield from _against("faster-{}", words, "IV-B, Fig. 2", measure, reached, "above")
    yield Claim("stated-times", "the 14th landmark is added after 19, 18 and 30 s", "IV-B", _stated_times)
    yield Claim("stated-entropies", "log₂\\|P\\| is then −530, −550 and −610", "IV-B", _stated_entropies)
    words = "at the same number of landmarks (iii) has lower entropy than {}"
    for ladder, counted in LADDERS.items():
        measure, lead = f"log₂\\|P\\| at the 14th landmark, {counted}", partial(lead_at_common_rung, ladder)
        yield from _against(f"entropy-{{}}-{ladder}", words, "IV-B, Fig. 2", measure, lead, "below", 0)
    words, final = (
        "(iii) needs more time to reduce entropy than {}",
        _lead(lambda runs, _: while_alive(runs, "final_log2_det")),
    )
    yield from _against("slower-{}", words, "IV-B", "log₂\\|P\\| at 35 s", final, "above", 0)
    words, measure = "(iii) estimates orientation much better than {}", "RMS orientation error, °"
    rms = _lead(lambda runs, _: np.degrees(while_alive(runs, "orientation_rms")))
    yield from _against("orientation-{}", words, "IV-B, Fig. 3", measure, rms, "below", 2)
    words, measure = "(iii) revisits the fiducials more often than {}", "fiducials matched in a frame"
    seen = _lead(lambda runs, _: column(runs, "fiducials_a_frame"))
    yield from _against("fiducials-{}", words, "IV-B", measure, seen, "above", 2)
    words, measure = "(iii) closes loops sooner than {}", "time of the first loop closure, s"
    closed = _lead(lambda runs, end: np.nan_to_num(column(runs, "first_closure"), nan=end))
    yield from _against("loops-{}", words, "IV-B", measure, closed, "below")
    yield Claim("closure-drop", "entropy drops where a loop closes", "V, Fig. 5 a", _closure_drop)
    yield Claim("honest-errors", "errors stay within their axes and 2σ bounds", "Fig. 3", _consistent_errors)
    yield Claim("homeostasis", "without unvisited landmarks the best action is always `stay`", "IV-A", _homeostasis)
    yield Claim("less-homeostasis", "unvisited landmarks prevent homeostasis", "IV-A", _less_homeostasis)
    yield Claim("approach", "Fisher information for motion drives the camera onto the landmarks", "III-B", _approach)
    words = "after new features come motions perpendicular to the line of sight"
    yield Claim("perpendicular", words, "III-B, V", _perpendicular)
    yield Claim("live-lateral", "the live commands are mostly up-down and left-right", "V, Fig. 5 b", _live)
    yield Claim("live-entropy", "log₂\\|P\\| falls to about −900 in 2500 frames", "Fig. 5 a", _live_entropy)
    yield Claim("clutter", "(ours) with 5 % missed and 2 false detections a frame, at most 5 % are lost", "–", _clutter)


CLAIMS: tuple[Claim, ...] = tuple(_claims())  # in the paper's order; the last is our own bar
