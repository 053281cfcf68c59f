"""The command and its reasons, and the other parts of the page, as pieces of HTML."""

import math
from html import escape
from typing import NamedTuple

import numpy as np

from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import Motion
from activeslam_gym.vision.film import BLUE, GREEN, GREY, ORANGE, OUTCOMES, SKY, VERMILLION

STANDINGS = dict(zip(Standing, (BLUE, GREEN, ORANGE, VERMILLION, GREY)))
CURVES = {"camera": VERMILLION, "map": SKY, "total": BLUE}
"""Colours of the entropies over time."""
NAMES = dict(
    zip(Motion, ("Move forward", "Move back", "Move right", "Move left", "Move up", "Move down", "Hold still"))
)
"""Commands in words."""
SIGNS = dict(zip(Motion, ("⤢", "⤡", "→", "←", "↑", "↓", "■")))
"""Commands as a character."""
_INSTEAD: dict[Standing | None, tuple[str, str]] = {
    None: ("Please wait", "Advice comes with the next images."),
    Standing.WAITING: ("Please wait", "Advice comes once the target has been seen."),
    Standing.LOST: ("Go back", "Advice comes once the map is in view again."),
    Standing.OVER: ("The end", "Restart to see it again."),
}
"""Words and reasons where there is no command: by the standing, or None where images do not come."""
_UP = "M50 6 L88 46 L64 46 L64 94 L36 94 L36 46 L12 46 Z"
_OUT = "M50 94 L80 62 L62 62 L57 34 L66 34 L50 8 L34 34 L43 34 L38 62 L20 62 Z"
_ROAD = f'<path d="M4 96 L36 6 M96 96 L64 6" stroke="{GREY}" stroke-width="5" fill="none"/>'
_SHAPES = dict(zip(Motion, (
    (_UP, "translate(22 20) scale(.56 .78)"), (_OUT, "translate(14 10) scale(.72 .86)"), (_UP, "rotate(90 50 50)"),
    (_UP, "rotate(270 50 50)"), (_UP, ""), (_UP, "rotate(180 50 50)"), ("M22 22 H78 V78 H22 Z", ""),
)))  # fmt: skip
"""Outlines and transforms of the arrows, in a square of 100: ahead along a road, back along it, sideways."""


# Pieces of the page -------------------------------------------------------------------------------------------------


def part(style: str, *inside: str, id: str = "") -> str:
    """A part of a panel; its ``id`` is what a test finds it by."""
    name = f' id="{id}"' if id else ""
    return f'<div style="padding:0 12px"><div{name} style="{style}">{"".join(inside)}</div></div>'


def title(text: str, unit: str) -> str:
    """A heading of a part of the page."""
    return part("font-size:13px;font-weight:600;padding:6px 0 2px", f'{text} <span style="opacity:.6">{unit}</span>')


class Advice(NamedTuple):
    """What the page advises the person to do."""

    motion: Motion
    words: str
    why: str


def advice(state: State, images: bool = True) -> Advice:
    """The command; other words where the standing allows none, or where no ``images`` come."""
    refused = state.standing == Standing.WAITING and state.frame > 0  # an image in the middle of a run
    motion, standing = state.command, state.standing if images and not refused else None
    if standing in _INSTEAD:
        return Advice(Motion.STAY, *_INSTEAD[standing])
    if not state.advised.any():
        return Advice(Motion.STAY, NAMES[Motion.STAY], "The first advice comes after a second.")
    more = state.scores[motion] - state.scores[Motion.STAY]
    why = "No motion promises more." if motion == Motion.STAY else f"+{more:.1f} bits over holding still"
    return Advice(motion, NAMES[motion], why)


def command(advice: Advice) -> str:
    """The command, large, with its arrow: sideways as it is; narrowing into the picture, widening out of it."""
    (motion, words, why), (outline, transform) = advice, _SHAPES[advice.motion]
    return part(
        "display:flex;align-items:center;gap:14px;padding:4px 2px",
        '<svg width="72" height="72" viewBox="0 0 100 100" aria-hidden="true">',
        _ROAD if motion in (Motion.FORWARD, Motion.BACKWARDS) else "",
        f'<path d="{outline}" transform="{transform}" fill="{BLUE}"/></svg>',
        f'<div><div style="font-size:30px;font-weight:700;line-height:1.15">{words}</div>',
        f'<div style="font-size:14px;opacity:.75">{why}</div></div>',
        id="command",
    )


def waiting(seconds: float, films: bool, compiles: bool) -> str:
    """The words on ``seconds`` without a state: of a device that ``films``, or while kernels may be compiled."""
    words = f"No image for {seconds:.0f} s."
    if films:
        words = f"No image for {seconds:.0f} s: press Film on the device whose camera is to be used."
    elif compiles:
        words = f"Getting ready for {seconds:.0f} s. The first time here it compiles, for a minute or two."
    return _strip(words, BLUE)


def standing(state: State, paused: bool) -> str:
    """The standing in words, on a coloured strip."""
    return _strip(*("Paused.", GREY) if paused else (state.words, STANDINGS[state.standing]))


def _strip(words: str, colour: str) -> str:
    style = f"border-left:6px solid {colour};padding:3px 8px;font-size:14px;background:{colour}22"
    return part(style, escape(words), id="standing")


def reasons(state: State) -> str:
    """The information of each motion, less that of holding still."""
    best = state.command if np.isfinite(state.scores).all() else None
    more = state.scores - state.scores[Motion.STAY]
    return bars("What each motion would teach", more, best, 1, "bits over holding still")


def bars(heading: str, values: np.ndarray, best: int | None, digits: int, unit: str) -> str:
    """(7,) a bar for each motion, that of ``best`` in blue; NaN is a dash, and what is not positive has no length."""
    shares = np.nan_to_num(values / max(np.nanmax(values, initial=0.0), 1e-9)).clip(0.0)
    rows = [
        f'<div style="font-weight:{700 if motion == best else 400}">{name.removeprefix("Move ").capitalize()}</div>'
        f'<div style="background:#8882;border-radius:3px"><div style="height:11px;border-radius:3px;width:{share:.1%};'
        f'background:{BLUE if motion == best else SKY}"></div></div>'
        f'<div style="text-align:right">{f"{value:.{digits}f}" if np.isfinite(value) else "–"}</div>'
        for (motion, name), value, share in zip(NAMES.items(), values, shares)
    ]
    grid = "display:grid;grid-template-columns:92px 1fr 44px;gap:2px 8px;align-items:center;font-size:13px"
    return title(heading, unit) + part(grid, *rows)


def counts(state: State) -> str:
    """Numbers of the moment."""
    spread = math.sqrt(max(float(np.trace(state.camera_covariance)), 0.0))
    known = state.standing != Standing.WAITING and math.isfinite(spread)
    cells = {
        "features": len(state.ids),
        "well placed": state.mapped.sum(),
        "images a second": f"{state.rate:.1f}",
        "time of an image": f"{state.milliseconds:.0f} ms",
        "place known to": f"{100.0 * spread:.1f} cm" if known else "–",
    }
    return part(
        "display:grid;grid-template-columns:repeat(3,1fr);gap:6px;font-size:12px;padding:4px 2px",
        *(f'<div><b style="font-size:17px">{value}</b><br>{name}</div>' for name, value in cells.items()),
    )


def legend() -> str:
    """The colours in the view and in the map."""
    balls = {BLUE: "well placed", SKY: "vague", ORANGE: "target", VERMILLION: "camera and its way"}
    rings, dots = (
        " &nbsp;".join(f'<span style="color:{colour}">{sign}</span> {word}' for colour, word in entries)
        for sign, entries in (("◯", OUTCOMES.values()), ("●", balls.items()))
    )
    return part("font-size:12px;line-height:1.5", f"In the view: {rings}<br>In the map: {dots}")
