"""The paper's claims, and what our runs say of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from agents.statistics import estimate
from agents.study import toy
from agents.study.conditions import CHOICES, DEFAULT, HAND_HELD_SECONDS, LIVE, PARTICLES_NOWHERE, STRATEGIES
from agents.study.measures import TARGET
from agents.study.runs import Rows
from agents.study.verdicts import (
    Array,
    Finding,
    Row,
    Side,
    at_common_rung,
    at_rung,
    column,
    difference,
    judge_draw,
    level,
    restricted,
    restricted_time,
    while_alive,
)

STATED = {"mi-constant": (19.0, -530.0), "mi-mi": (18.0, -550.0), "mi-fisher": (30.0, -610.0)}
"""Strategy → time of the 14th landmark [s] and log₂|P| then, as the paper reads them off figure 2 d–f."""
STATED_LIVE = -900.0
"""log₂|P| after 2500 frames of the live system, the end of figure 5 a's axis."""
CHANCE_LATERAL = 4.0 / 7.0
"""Share of the commands that are lateral if all seven are as likely."""
ALWAYS = 0.95
"""A share that is called `always`."""
LOST_BAR = 0.05
"""Most runs that may be lost under `clutter`."""
LADDERS = {"ladder_log2_det": "unvisited counted", "ladder_visited": "visited alone"}
FISHER_MOTIONS = {DEFAULT: "trace", "eigenvalue": "largest eigenvalue", "unpropagated": "trace of horizon 0"}
"""Choice → what a motion by Fisher information is then chosen by."""
SCENES = range(100)
"""Seeds of the scenes of figure 1."""
OWN, OTHERS = "mi-fisher", ("mi-constant", "mi-mi")


@dataclass(frozen=True)
class Claim:
    """What the paper says, and how our runs answer."""

    key: str
    words: str
    """The paper's, shortened."""
    where: str
    """Section or figure."""
    findings: Callable[[Rows], Iterator[Finding]]
    """The main choice of each measure first."""


def findings_of(rows: Rows, claims: Sequence[Claim] | None = None) -> list[Finding]:
    """What the rows say of every claim."""
    return [finding for claim in claims or CLAIMS for finding in claim.findings(rows)]


# Simulation: the three strategies -----------------------------------------------------------------------------------


Judge = Callable[[Rows], Iterator[Finding]]


def _against(
    key: str, other: str, what: str, values: Callable[[Sequence[Row], float], Array], side: Side, digits: int = 1
) -> Judge:
    """Findings on (iii) minus another strategy, under every choice; `values` of runs and the duration."""

    def findings(rows: Rows) -> Iterator[Finding]:
        measure = f"{what}, (iii) − {STRATEGIES[other]}"
        for choice in CHOICES:
            ours, theirs = rows[choice.name, OWN], rows[choice.name, other]
            pair = values(ours, rows.duration), values(theirs, rows.duration)
            yield difference(key, choice.name, measure, pair, side, digits=digits)

    return findings


def _entropy_at(key: str, other: str, ladder: str) -> Judge:
    def findings(rows: Rows) -> Iterator[Finding]:
        measure = f"log₂\\|P\\| at the 14th landmark, {LADDERS[ladder]}, (iii) − {STRATEGIES[other]}"
        for choice in CHOICES:
            pair = at_common_rung(rows[choice.name, OWN], rows[choice.name, other], ladder, TARGET)
            yield difference(key, choice.name, measure, pair, "below", digits=0)

    return findings


def _stated_times(rows: Rows) -> Iterator[Finding]:
    for strategy, (time, _) in STATED.items():
        times = restricted_time(rows[DEFAULT, strategy], TARGET, rows.duration)
        reached = int(np.sum(times < rows.duration))
        yield Finding(
            "stated-times",
            DEFAULT,
            f"median time of the 14th landmark, s, {STRATEGIES[strategy]} (the paper: {time:g})",
            estimate(times, "median"),
            judge_draw(times.tolist(), time),
            note=f"{_spread(times)}, {int(np.sum(times <= time))} as early; reached in {reached} of {len(times)}",
        )


def _stated_entropies(rows: Rows) -> Iterator[Finding]:
    for ladder, counted in LADDERS.items():
        for strategy, (_, log2_det) in STATED.items():
            values = at_rung(rows[DEFAULT, strategy], ladder, TARGET)
            yield Finding(
                "stated-entropies",
                DEFAULT,
                f"median log₂\\|P\\| at the 14th landmark, {counted}, {STRATEGIES[strategy]} (paper: {log2_det:.0f})",
                estimate(values, "median"),
                judge_draw(values.tolist(), log2_det),
                digits=0,
                note=f"{int(np.sum(~np.isnan(values)))} rooms reached it; {_spread(values)}",
            )


def _spread(values: Array) -> str:
    """The central 95 % of the rooms, in words."""
    if np.isnan(values).all():
        return "no room to tell"
    low, high = np.nanquantile(values, (0.025, 0.975))
    return f"central 95 % of rooms {low:.0f} … {high:.0f}"


def _honest_errors(rows: Rows) -> Iterator[Finding]:
    forms = {
        "position_in_axis": ("% of position errors within ±0.2 m", 0.95),
        "quaternion_in_axis": ("% of quaternion errors within ±0.02", 0.95),
        "position_in_bounds": ("% of position errors within 2σ (nominal 95.4)", 0.9),
        "orientation_in_bounds": ("% of orientation errors within 2σ (nominal 95.4)", 0.9),
    }
    for name, (measure, bound) in forms.items():
        for strategy, numeral in STRATEGIES.items():
            values = column(rows[DEFAULT, strategy], name)
            yield level("honest-errors", DEFAULT, f"{measure}, {numeral}", values, "above", bound, 100.0)


def _closure_drop(rows: Rows) -> Iterator[Finding]:
    runs = {numeral: rows[DEFAULT, strategy] for strategy, numeral in STRATEGIES.items()}
    runs |= {name: rows[name, LIVE] for name in ("hand-held", "calm")}
    for part in ("camera", "total"):
        for name, those in runs.items():
            pair = column(those, f"closure_change_{part}"), column(those, f"before_change_{part}")
            measure = f"change of log₂\\|P\\| ({part}) in the second from a closure on − before it, {name}"
            yield difference("closure-drop", DEFAULT, measure, pair, "below")


def _homeostasis(rows: Rows) -> Iterator[Finding]:
    for strategy, numeral in STRATEGIES.items():
        for choice, initialiser in (("nowhere", "inverse depth"), (PARTICLES_NOWHERE, "particles")):
            values = column(rows[choice, strategy], "stay_share")
            measure = f"% of motions that are `stay` without expected landmarks, {numeral}"
            yield level("homeostasis", initialiser, measure, values, "above", ALWAYS, 100.0)


def _less_homeostasis(rows: Rows) -> Iterator[Finding]:
    for strategy, numeral in STRATEGIES.items():
        for choice, with_them, initialiser in (
            ("nowhere", DEFAULT, "inverse depth"),
            (PARTICLES_NOWHERE, "particles", "particles"),
        ):
            pair = column(rows[choice, strategy], "stay_share"), column(rows[with_them, strategy], "stay_share")
            measure = f"% of motions that are `stay`, without − with expected landmarks, {numeral}"
            yield difference("less-homeostasis", initialiser, measure, pair, "above", 100.0)


def _approach(rows: Rows) -> Iterator[Finding]:
    forms: dict[str, tuple[str, Side, float, int]] = {
        "nearest_mean": ("mean distance to the nearest point in view, m", "below", 1.0, 2),
        "fiducial_distance": ("mean distance to the fiducials, m", "below", 1.0, 2),
        "forward_share": ("% of motions that are `forward`", "above", 100.0, 1),
    }
    for name, (measure, side, scale, digits) in forms.items():
        for choice, metric in FISHER_MOTIONS.items():
            pair = column(rows[choice, "fisher-fisher"], name), column(rows[choice, OWN], name)
            measure_here = f"{measure}, Fisher − MI motion"
            yield difference("approach", metric, measure_here, pair, side, scale, digits)


def _perpendicular(rows: Rows) -> Iterator[Finding]:
    runs = {numeral: rows[DEFAULT, strategy] for strategy, numeral in STRATEGIES.items()}
    runs |= {name: rows[name, LIVE] for name in ("hand-held", "calm")}
    for event in ("birth", "mapping"):
        for name, those in runs.items():
            after = column(those, f"lateral_after_{event}")
            measure = f"% of motions that are lateral after a {event}"
            yield level("perpendicular", event, f"{measure}, {name} (chance 57)", after, "above", CHANCE_LATERAL, 100.0)
            pair = after, column(those, "lateral_otherwise")
            yield difference("perpendicular", event, f"{measure} − otherwise, {name}", pair, "above", 100.0)


def _live(rows: Rows) -> Iterator[Finding]:
    for name in ("hand-held", "calm"):
        those = rows[name, LIVE]
        minute = column(those, "lateral_first_minute")
        measure = f"% of motions that are lateral in the first minute, {name} (chance 57)"
        yield level("live-lateral", name, measure, minute, "above", CHANCE_LATERAL, 100.0)


def _live_entropy(rows: Rows) -> Iterator[Finding]:
    for name in ("hand-held", "calm"):
        those = rows[name, LIVE]
        values = while_alive(those, "final_log2_det")
        alive = int(np.sum(~np.isnan(values)))
        yield Finding(
            "live-entropy",
            name,
            f"median log₂\\|P\\| after {HAND_HELD_SECONDS:g} s, {name} (the paper: about {STATED_LIVE:.0f})",
            estimate(values, "median"),
            judge_draw(values.tolist(), STATED_LIVE),
            digits=0,
            note=f"{alive} of {len(values)} runs were not lost by then",
        )


def _clutter(rows: Rows) -> Iterator[Finding]:
    for policy in (*STRATEGIES, "sweep", "random"):
        lost = column(rows["clutter", policy], "lost")
        measure = f"% lost under `clutter`, {policy} (bar: {100 * LOST_BAR:g})"
        yield level("clutter", "clutter", measure, lost, "below", LOST_BAR, 100.0, statistic="share")


def _figure_1(rows: Rows) -> Iterator[Finding]:
    for view, half_view in (("96° view", np.radians(48.0)), ("sees all around", np.pi)):
        for shape, isotropic in (("isotropic landmarks", True), ("landmarks long along the sight", False)):
            inside = [toy.lies_between(toy.drawn(seed, isotropic, half_view)) for seed in SCENES]
            measure = "% of drawn scenes whose best move lies between landmarks 2 and 3 (more than half?)"
            yield level(
                "figure-1", f"{view} with {shape}", measure, np.array(inside, float), "above", 0.5, 100.0, 0, "share"
            )


def _claims() -> Iterator[Claim]:
    yield Claim("figure-1", "moving between landmarks 2 and 3 maximises the mutual information", "Fig. 1", _figure_1)
    for other in OTHERS:
        numeral = STRATEGIES[other]
        against = _against(
            f"faster-{other}",
            other,
            "time of the 14th landmark, s",
            lambda runs, end: restricted_time(runs, TARGET, end),
            "above",
        )
        yield Claim(f"faster-{other}", f"{numeral} inserts landmarks faster than (iii)", "IV-B, Fig. 2", against)
    yield Claim("stated-times", "the 14th landmark is added after 19, 18 and 30 s", "IV-B", _stated_times)
    yield Claim("stated-entropies", "log₂\\|P\\| is then −530, −550 and −610", "IV-B", _stated_entropies)
    for other in OTHERS:
        for ladder in LADDERS:
            key = f"entropy-{other}-{ladder}"
            words = f"at the same number of landmarks (iii) has lower entropy than {STRATEGIES[other]}"
            yield Claim(key, words, "IV-B, Fig. 2", _entropy_at(key, other, ladder))
    for other in OTHERS:
        numeral, key = STRATEGIES[other], f"slower-{other}"
        final = _against(
            key, other, "log₂\\|P\\| at 35 s", lambda runs, _: while_alive(runs, "final_log2_det"), "above", digits=0
        )
        yield Claim(key, f"(iii) needs more time to reduce entropy than {numeral}", "IV-B", final)
    for other in OTHERS:
        key = f"orientation-{other}"
        rms = _against(
            key,
            other,
            "RMS orientation error, °",
            lambda runs, _: np.degrees(while_alive(runs, "orientation_rms")),
            "below",
            digits=2,
        )
        yield Claim(key, f"(iii) estimates orientation much better than {STRATEGIES[other]}", "IV-B, Fig. 3", rms)
    for other in OTHERS:
        key = f"fiducials-{other}"
        seen = _against(
            key,
            other,
            "fiducials matched in a frame",
            lambda runs, _: column(runs, "fiducials_a_frame"),
            "above",
            digits=2,
        )
        yield Claim(key, f"(iii) revisits the fiducials more often than {STRATEGIES[other]}", "IV-B", seen)
    for other in OTHERS:
        key = f"loops-{other}"
        first = _against(
            key,
            other,
            "time of the first loop closure, s",
            lambda runs, end: restricted(runs, "first_closure", end),
            "below",
        )
        yield Claim(key, f"(iii) closes loops sooner than {STRATEGIES[other]}", "IV-B", first)
    yield Claim("closure-drop", "entropy drops where a loop closes", "V, Fig. 5 a", _closure_drop)
    yield Claim("honest-errors", "errors stay within their axes and 2σ bounds", "Fig. 3", _honest_errors)
    yield Claim("homeostasis", "without unvisited landmarks the best action is always `stay`", "IV-A", _homeostasis)
    yield Claim("less-homeostasis", "unvisited landmarks prevent homeostasis", "IV-A", _less_homeostasis)
    yield Claim("approach", "Fisher information for motion drives the camera onto the landmarks", "III-B", _approach)
    yield Claim(
        "perpendicular",
        "after new features come motions perpendicular to the line of sight",
        "III-B, V",
        _perpendicular,
    )
    yield Claim("live-lateral", "the live commands are mostly up-down and left-right", "V, Fig. 5 b", _live)
    yield Claim("live-entropy", "log₂\\|P\\| falls to about −900 in 2500 frames", "Fig. 5 a", _live_entropy)
    yield Claim("clutter", "(ours) with 5 % missed and 2 false detections a frame, at most 5 % are lost", "–", _clutter)


CLAIMS: tuple[Claim, ...] = tuple(_claims())
"""In the paper's order; the last is our own bar."""
