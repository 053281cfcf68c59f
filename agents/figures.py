"""Pictures of a comparison: the paper's figures 2, 3 and 5 b for any policies. matplotlib is imported where it draws.

Each takes policy → episodes by seed, and draws trajectories and maps of the first room.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym import Gaze, Motion
from activeslam_gym.evaluation import Episode, row_of
from activeslam_gym.evaluation.episode import nearest
from activeslam_gym.files import written_whole
from activeslam_gym.rendering.scene import FIDUCIAL, ellipses
from agents.summary import aggregate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS_A_ROW = 4
SIGMAS = 2.0  # standard deviations of the bounds and of the ellipses
BAND = (10.0, 90.0)  # percentiles over episodes of the band around a mean
ERRORS = ("X error, m", "Y error, m", "Z error, m", "qx error", "qy error", "qz error")
PARTS = {"camera": "tab:blue", "map": "tab:green", "total": "tab:red"}
ESTIMATE, TRUTH, BOUND, LOST = "tab:blue", "black", "tab:red", "tab:red"

Runs = Mapping[str, Sequence[Episode]]  # policy → its episodes by seed
Curves = tuple[np.ndarray, np.ndarray]  # times (G,), and values (curves, G)


def scores(by_policy: Runs) -> Figure:
    """The log score gained in each episode, the best policy on top, with the median and its 95 % interval."""
    gains = {name: np.array([run.gain for run in runs]) for name, runs in by_policy.items()}
    medians = {name: aggregate(values, "median") for name, values in gains.items()}
    order = sorted(medians, key=lambda name: np.nan_to_num(medians[name].value, nan=-np.inf))
    high = 1.05 * max(1.0, *(np.nanmax(values, initial=1.0) for values in gains.values()))
    low = -0.15 * high
    figure, (axes,) = several_panels(1, (7.5, 1.2 + 0.32 * len(order)))
    for row, name in enumerate(order):
        lost = np.array([run.lost for run in by_policy[name]])
        shown = np.fmax(gains[name], 0.97 * low)
        axes.plot(shown[~lost], np.full(np.sum(~lost), row), "|", color=ESTIMATE, ms=9, alpha=0.5)
        axes.plot(shown[lost], np.full(np.sum(lost), row), "x", color=LOST, ms=5)
        median = medians[name]
        axes.plot([median.low, median.high], [row, row], color=TRUTH, linewidth=2.0)
        axes.plot(median.value, row, "D", color=TRUTH, ms=5)
    axes.axvline(0.0, color="0.7", linewidth=0.8, zorder=0)
    axes.set(yticks=range(len(order)), yticklabels=order, ylim=(-0.6, len(order) - 0.4), xlim=(low, high))
    axes.set(xlabel="log score gained, bits; ◆ median with 95 % interval, red × lost; lower ones at the left edge")
    return figure


def entropies(by_policy: Runs) -> Figure:
    """Fig. 2 d–f: log₂|P| over time, the first episode with a mark at each new landmark, mean and band over all."""
    figure, panels = several_panels(len(by_policy), sharex=True, sharey=True)
    for axes, (name, runs) in zip(panels, by_policy.items()):
        entropy_panel(axes, runs[0], {part: over_rooms(runs, f"log2_det_{part}") for part in PARTS})
        axes.set(xlabel="time, s", ylabel="log₂|P|")
        _title(axes, f"{name} ({len(runs)} episodes, {sum(run.lost for run in runs)} lost)", runs[0])
    panels[0].legend(fontsize=7)
    low, high = BAND
    figure.suptitle(f"Entropy: episode {_first_seed(by_policy)} (line), mean (dashed) and {low:g}–{high:g} % band")
    return figure


def entropy_panel(axes: Axes, drawn: Episode, curves: Mapping[str, Curves]) -> None:
    """log₂|P| of a run with a mark at each new landmark; mean and band of part → curves, where a tenth of them last."""
    for part, colour in PARTS.items():
        times, values = curves[part]
        enough = np.sum(~np.isnan(values), axis=0) >= max(1, len(values) // 10)
        times, values = times[enough], values[:, enough]
        axes.fill_between(times, *np.nanpercentile(values, BAND, axis=0), color=colour, alpha=0.15, linewidth=0)
        axes.plot(times, np.nanmean(values, axis=0), "--", color=colour, linewidth=0.8)
        axes.plot(drawn.times, getattr(drawn, f"log2_det_{part}"), color=colour, linewidth=1.2, label=part)
    axes.plot(drawn.landmark_times, drawn.landmark_log2_det, "k+", markersize=5, label="new landmark")


def errors(by_policy: Runs) -> Figure:
    """Fig. 3: errors of position and of the quaternion's vector part in the first room, with 2σ bounds."""
    figure, grid = grid_of_panels(len(ERRORS), len(by_policy), (3.4, 1.5), sharex=True, sharey="row")
    for column, (name, (first, *_)) in enumerate(by_policy.items()):
        vector = Rotation.from_rotvec(first.rotation_offset).as_quat(canonical=True)[:, :3]
        offsets = np.hstack((first.position_offset, vector))
        bounds = SIGMAS * np.hstack((first.position_std, first.rotation_std / 2.0))
        for axes, label, offset, bound in zip(grid[:, column], ERRORS, offsets.T, bounds.T):
            axes.plot(first.times, offset, color=ESTIMATE, linewidth=0.8)
            axes.plot(first.times, bound, first.times, -bound, color=BOUND, linewidth=0.8)
            axes.set_ylabel(label if column == 0 else "")
        grid[0, column].set_title(name, fontsize=9)
        grid[-1, column].set_xlabel("time, s")
    figure.suptitle(f"True − estimated (blue) and {SIGMAS:g}σ bounds (red), episode {_first_seed(by_policy)}")
    return figure


def maps(by_policy: Runs) -> Figure:
    """Fig. 2 a–c: the final map and the trajectories of the first room, seen from above."""
    figure, panels = several_panels(len(by_policy), (4.2, 4.8), sharex=True, sharey=True)
    for axes, (name, (first, *_)) in zip(panels, by_policy.items()):
        _map(axes, first)
        _title(axes, f"{name}: {first.landmarks_mapped[-1]} mapped", first)
    legend_below(figure, panels[:1])
    figure.suptitle(f"Map and trajectories, episode {_first_seed(by_policy)}, from above ({SIGMAS:g}σ ellipses)")
    return figure


def actions(by_policy: Runs) -> Figure:
    """Fig. 5 b: shares of the commands, over all episodes; a bar for each policy."""
    figure, panels = several_panels(2, (6.0, 3.4))
    width = 0.8 / len(by_policy)
    for axes, choices in zip(panels, (Motion, Gaze)):
        what = choices.__name__.lower()
        for i, (name, runs) in enumerate(by_policy.items()):
            rows = [row_of(run) for run in runs]
            count = np.array([sum(row[f"{what}_{choice.name.lower()}"] for row in rows) for choice in choices])
            places = np.arange(len(choices)) + (i - (len(by_policy) - 1) / 2.0) * width
            axes.bar(places, count / max(count.sum(), 1), width, label=name)
        axes.set_xticks(range(len(choices)), [choice.name.lower() for choice in choices], fontsize=8)
        axes.set(title=f"{choices.__name__}, a command each {what} period")
    panels[0].set(ylabel="share of commands")
    legend_below(figure, panels[:1], PANELS_A_ROW)
    return figure


def live(drawn: Episode, runs: Sequence[Episode], until: float) -> Figure:
    """Fig. 5: log₂|P| over time of a run, mean and band over all, and the run's commands ``until`` a time [s]."""
    figure, (left, right) = several_panels(2, (5.4, 3.0))
    entropy_panel(left, drawn, {part: over_rooms(runs, f"log2_det_{part}") for part in PARTS})
    read = np.flatnonzero(drawn.motion_read & (drawn.times[:-1] < until))
    right.step(drawn.times[read], drawn.actions[read, 0], where="post", color=ESTIMATE, linewidth=1.0)
    right.set_yticks(range(len(Motion)), [motion.name.lower() for motion in Motion], fontsize=7)
    left.set(xlabel="time, s", ylabel="log₂|P|")
    right.set(xlabel="time, s", title="commands")
    left.legend(fontsize=7)
    _title(left, f"episode {drawn.seed}; {sum(run.lost for run in runs)} of {len(runs)} lost", drawn)
    return figure


def over_rooms(runs: Sequence[Episode], field: str) -> Curves:
    """A sampled field of the runs at whole seconds of the longest; NaN after a run's end."""
    longest = max((run.times for run in runs), key=lambda times: times[-1])
    times = longest[nearest(longest, 1.0)]
    return times, np.array([np.interp(times, run.times, getattr(run, field), right=np.nan) for run in runs])


def grid_of_panels(rows: int, columns: int, size: tuple[float, float], **shared: Any) -> tuple[Figure, np.ndarray]:
    """A figure with rows × columns panels of this size [inch]; without pyplot, which asks for a window system."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * size[0], rows * size[1] + 0.7), layout="constrained")
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=0.06, h_pad=0.09)  # inches between a title and the panel above it
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def legend_below(figure: Figure, panels: Iterable[Axes], most: int = 9) -> None:
    """One legend of `panels` under all, each label once, at most so many in a row."""
    handles = {label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels())}
    columns = min(len(handles), most)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns, fontsize=8)


def save_figure(figure: Figure, path: Path, dpi: int = 130) -> None:
    """Write the figure as a PNG."""
    with written_whole(path) as unfinished:
        figure.savefig(unfinished, format="png", dpi=dpi)


def _map(axes: Axes, run: Episode) -> None:
    """Z upwards and so X to the left: the room, truth in black, the estimate in blue; not mapped is hollow."""
    plane = np.array([0, 2])
    half = run.room_size[plane] / 2.0
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * half
    mapped, missed = run.estimated_landmarks[:, plane], np.isnan(run.landmark_errors)
    outlines = ellipses(mapped, run.landmark_covariance[:, plane[:, None], plane], SIGMAS)
    axes.plot(*corners.T, color="grey", linewidth=0.8)
    unmapped = run.true_landmarks[missed][:, plane]
    axes.plot(*unmapped.T, "o", mfc="none", mec=TRUTH, mew=0.8, ms=4.5, label="landmark, not mapped")
    axes.plot(*run.fiducials[:, plane].T, "s", color=FIDUCIAL, ms=4, label="fiducial")
    for outline in outlines:
        axes.fill(*outline.T, facecolor="#1F77B440", edgecolor=ESTIMATE, linewidth=0.9)
    axes.plot(*mapped.T, ".", color=ESTIMATE, ms=5, label="mapped")
    axes.plot(*run.true_landmarks[~missed][:, plane].T, "kx", ms=3.5, mew=0.8, label="its truth")
    axes.plot(*run.true_position[:, plane].T, color=TRUTH, lw=1.0, label="true path")
    axes.plot(*run.estimated_position[:, plane].T, color=ESTIMATE, lw=0.8, label="estimated")
    (right, top), (left, bottom) = 1.1 * half, -1.1 * half
    axes.set(xlim=(right, left), ylim=(bottom, top), aspect="equal", xlabel="X, m", ylabel="Z, m")


def several_panels(
    count: int, size: tuple[float, float] = (4.2, 3.2), most: int = PANELS_A_ROW, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels, at most so many in a row; the rest of the last row stays empty."""
    rows = -(-count // most)
    columns = -(-count // rows)
    figure, grid = grid_of_panels(rows, columns, size, **shared)
    for above, axes in zip(grid.flat[count - columns :], grid.flat[count:]):
        axes.set_axis_off()
        above.tick_params(labelbottom=True)  # shared axes have their numbers in the last row alone
    return figure, list(grid.flat[:count])


def _title(axes: Axes, title: str, drawn: Episode) -> None:
    """A panel's title, which tells when the run that it draws was lost."""
    axes.set_title(f"{title}\nthis episode was lost" if drawn.lost else title, color=LOST if drawn.lost else TRUTH)


def _first_seed(by_policy: Runs) -> int:
    """Seed of the room that is drawn."""
    return next(iter(by_policy.values()))[0].seed


FIGURES = {"entropies.png": entropies, "errors.png": errors, "maps.png": maps, "scores.png": scores}
"""The figures of a comparison, by the names of their files."""
