"""The camera's view with the searched ellipses, and the command, as pictures and as pieces of HTML."""

import math
from html import escape
from typing import Any

import numpy as np

from activeslam_gym.live.state import LOST, OVER, TRACKING, UNSURE, WAITING, State
from activeslam_gym.motion import Motion
from activeslam_gym.vision.frontend import DOUBTED, MATCHED, MISSED
from activeslam_gym.vision.opencv import opencv

# Okabe and Ito's colours, safe for colour-blind readers, as in `rendering.scene`.
BLUE, SKY, ORANGE, VERMILLION, GREEN, GREY = "#0072B2", "#56B4E9", "#E69F00", "#D55E00", "#009E73", "#9AA0A6"
OUTCOMES = {MATCHED: (GREEN, "found"), MISSED: (VERMILLION, "missed"), DOUBTED: (ORANGE, "rejected")}
"""Colour and word for each outcome of a search."""
STANDINGS = {TRACKING: GREEN, UNSURE: ORANGE, LOST: VERMILLION, WAITING: BLUE, OVER: GREY}
NAMES = {
    Motion.FORWARD: "Move forward",
    Motion.BACKWARDS: "Move back",
    Motion.RIGHT: "Move right",
    Motion.LEFT: "Move left",
    Motion.UP: "Move up",
    Motion.DOWN: "Move down",
    Motion.STAY: "Hold still",
}
"""Commands in words."""
SIGNS = dict(zip(Motion, ("⤢", "⤡", "→", "←", "↑", "↓", "■")))
"""Commands as a character."""
SCALE = 2
"""Pixels of the picture for one of the image."""
_SIGMAS = 3.0
_TURNS = {Motion.UP: 0, Motion.RIGHT: 90, Motion.DOWN: 180, Motion.LEFT: 270}
_ARROW = "M50 6 L88 46 L64 46 L64 94 L36 94 L36 46 L12 46 Z"
_INTO = "M50 8 L66 34 L57 34 L62 62 L80 62 L50 94 L20 62 L38 62 L43 34 L34 34 Z"


def rgb(colour: str) -> tuple[int, int, int]:
    """``#RRGGBB`` as three numbers of 0 … 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def view(state: State) -> np.ndarray:
    """(2 h, 2 w, 3) uint8, RGB: the image with the 3-sigma ellipses of the searches, coloured by their outcomes."""
    cv2 = opencv()
    size = (SCALE * state.image.shape[1], SCALE * state.image.shape[0])
    picture = cv2.cvtColor(cv2.resize(state.image, size, interpolation=cv2.INTER_LINEAR), cv2.COLOR_GRAY2RGB)
    for id, pixel, covariance, outcome in zip(state.searched, state.pixels, state.ellipses, state.outcomes):
        colour, marked = rgb(OUTCOMES[int(outcome)][0]), state.marked != 0 and id == state.marked
        _ellipse(cv2, picture, pixel, covariance, colour, 4 if marked else 2)
        if marked:
            at = (int(SCALE * pixel[0]), int(SCALE * pixel[1]))
            cv2.drawMarker(picture, at, rgb(VERMILLION), cv2.MARKER_TILTED_CROSS, 24, 3)
    return picture


def _ellipse(cv2: Any, picture: np.ndarray, pixel: np.ndarray, covariance: np.ndarray, colour: Any, width: int) -> None:
    """Draw the contour of a Gaussian, of a visible size, unless it is larger than the picture."""
    if not (np.isfinite(pixel).all() and np.isfinite(covariance).all()):
        return
    squares, axes = np.linalg.eigh(covariance)
    if not (0.0 < squares[0] and squares[1] < picture.shape[1] ** 2):
        return
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    whole = np.maximum(2.0 * _SIGMAS * SCALE * np.sqrt(squares[::-1]), 10.0)
    middle = SCALE * (np.asarray(pixel) + 0.5) - 0.5
    box = (tuple(middle.tolist()), tuple(whole.tolist()), angle)
    cv2.ellipse(picture, box, colour, width, cv2.LINE_AA)


# Pieces of the page -------------------------------------------------------------------------------------------------


def arrow(motion: Motion, colour: str, size: int) -> str:
    """An arrow as SVG: sideways as it is; a narrowing one into the picture, a widening one out of it."""
    if motion in _TURNS:
        shape = f'<path d="{_ARROW}" transform="rotate({_TURNS[motion]} 50 50)" fill="{colour}"/>'
    elif motion == Motion.STAY:
        shape = f'<rect x="22" y="22" width="56" height="56" rx="8" fill="{colour}"/>'
    else:
        road = f'<path d="M4 96 L36 6 M96 96 L64 6" stroke="{GREY}" stroke-width="5" fill="none"/>'
        path = _ARROW if motion == Motion.FORWARD else _INTO
        turn = "translate(22 20) scale(.56 .78)" if motion == Motion.FORWARD else "translate(14 10) scale(.72 .86)"
        shape = f'{road}<path d="{path}" transform="{turn}" fill="{colour}"/>'
    return f'<svg width="{size}" height="{size}" viewBox="0 0 100 100" aria-hidden="true">{shape}</svg>'


def command(state: State) -> str:
    """The command, large, with its arrow."""
    motion = state.motion
    if state.standing in (WAITING, OVER):
        words, why = "Please wait", "Advice comes once the target has been seen."
    elif np.isnan(state.scores).all():
        words, why = NAMES[Motion.STAY], "The first advice comes after a second."
    else:
        more = state.scores[motion] - state.scores[Motion.STAY]
        words = NAMES[motion]
        why = f"+{more:.1f} bits over holding still" if motion != Motion.STAY else "No motion promises more."
    return (
        f'<div id="command" style="display:flex;align-items:center;gap:14px;padding:4px 2px">{arrow(motion, BLUE, 72)}'
        f'<div><div style="font-size:30px;font-weight:700;line-height:1.15">{words}</div>'
        f'<div style="font-size:14px;opacity:.75">{why}</div></div></div>'
    )


def standing(state: State, paused: bool) -> str:
    """The standing in words, on a coloured strip."""
    words = "Paused." if paused else state.words
    colour = GREY if paused else STANDINGS[state.standing]
    return (
        f'<div id="standing" style="border-left:6px solid {colour};padding:3px 8px;font-size:14px;'
        f'background:{colour}22">{escape(words)}</div>'
    )


def bars(heading: str, values: np.ndarray, best: int | None, digits: int, unit: str) -> str:
    """(7,) a bar for each motion, that of ``best`` in blue; NaN is a dash."""
    most = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    rows = []
    for motion, value in zip(Motion, np.asarray(values, float)):
        share = 100.0 * value / most if most > 0.0 and np.isfinite(value) else 0.0
        text = f"{value:.{digits}f}" if np.isfinite(value) else "–"
        colour, weight = (BLUE, 700) if motion == best else (SKY, 400)
        rows.append(
            f'<div style="width:92px;font-weight:{weight}">{NAMES[motion].removeprefix("Move ").capitalize()}</div>'
            f'<div style="background:#8882;height:11px;border-radius:3px"><div style="width:{max(share, 0.0):.1f}%;'
            f'background:{colour};height:11px;border-radius:3px"></div></div>'
            f'<div style="text-align:right">{text}</div>'
        )
    grid = "display:grid;grid-template-columns:auto 1fr 44px;gap:2px 8px;align-items:center;font-size:13px"
    return f'{title(heading, unit)}<div style="{grid}">{"".join(rows)}</div>'


CURVES = {"camera": VERMILLION, "map": SKY, "total": BLUE}
"""Colours of the entropies over time."""
_POINTS = 240
"""Of a curve, beside its dots, at most."""


def columns(rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """(5 columns) for a plot of the entropies ``rows`` (k, 5) of `History.curves`: time, camera, map, total, dots.

    A dot is the total where a landmark is new, else NaN. Between landmarks, rows are left out.
    """
    rows = rows[np.isfinite(rows).all(1)]
    new = rows[:, 4] > 0.0
    rows, new = (column[new | (np.arange(len(rows)) % max(-(-len(rows) // _POINTS), 1) == 0)] for column in (rows, new))
    return *rows[:, :4].T.copy(), np.where(new, rows[:, 3], np.nan)


def counts(state: State) -> str:
    """Numbers of the moment."""
    found = int((state.outcomes == MATCHED).sum())
    cells = {
        "features": str(len(state.ids)),
        "well placed": str(int(state.mapped.sum())),
        "found": f"{found} of {len(state.outcomes)}",
        "images a second": f"{state.rate:.1f}",
        "time of an image": f"{state.milliseconds:.0f} ms",
        "place known to": f"{100.0 * math.sqrt(max(float(np.trace(state.camera_covariance)), 0.0)):.1f} cm",
    }
    inner = "".join(
        f'<div><div style="font-size:17px;font-weight:600">{value}</div><div style="opacity:.7">{name}</div></div>'
        for name, value in cells.items()
    )
    return (
        f'<div style="display:grid;grid-template-columns:repeat(3,1fr);gap:6px;font-size:12px;padding:4px 2px">'
        f"{inner}</div>"
    )


def legend() -> str:
    """The colours in the view and in the map."""
    rings = "".join(f'<span style="color:{colour}">◯</span> {word} &nbsp;' for colour, word in OUTCOMES.values())
    balls = {BLUE: "well placed", SKY: "vague", ORANGE: "target", VERMILLION: "camera and its way"}
    dots = "".join(f'<span style="color:{colour}">●</span> {word} &nbsp;' for colour, word in balls.items())
    return f'<div style="font-size:12px;line-height:1.5">In the view: {rings}<br>In the map: {dots}</div>'


def mark(state: State) -> str:
    """The distance of the marked feature, in words."""
    at = np.flatnonzero(state.ids == state.marked)
    if state.marked == 0:
        text = "Nothing is marked. Click a feature in the map, or mark the one in the middle of the view."
    elif not len(at):
        text = "The marked feature has been deleted from the map."
    else:
        way = state.points[at[0]] - state.camera[:3]
        distance = float(np.linalg.norm(way))
        std = math.sqrt(max(float(way @ state.covariances[at[0]] @ way), 0.0)) / max(distance, 1e-9)
        text = f"Marked: {distance:.2f} m away, known to {100.0 * std:.0f} cm."
    return f'<div id="marked" style="font-size:13px;padding:2px">{text}</div>'


def middle_feature(state: State) -> int:
    """Id of the searched feature that is nearest to the middle of the image, or 0."""
    known = np.flatnonzero(state.searched > 0)
    if not len(known):
        return 0
    h, w = state.image.shape
    away = np.linalg.norm(state.pixels[known] - (0.5 * w, 0.5 * h), axis=1)
    return int(state.searched[known[away.argmin()]])


def title(text: str, unit: str) -> str:
    """A heading of a part of the page."""
    style = "font-size:13px;font-weight:600;padding:6px 0 2px"
    return f'<div style="{style}">{text} <span style="opacity:.6">{unit}</span></div>'
