"""The picture of a snapshot: the map, the camera's image and the entropy on one figure of matplotlib.

A panel's artists are made once and moved from frame to frame. It imports matplotlib (the extra ``plot``) at its top, so
it is itself imported when something is drawn.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

try:
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgba_array
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator
except ImportError as error:
    raise gymnasium.error.DependencyNotInstalled(
        "matplotlib is needed to render: pip install matplotlib, or in a clone: pip install -e '.[plot]'"
    ) from error

from activeslam_gym.rendering import scene

if TYPE_CHECKING:
    from activeslam_gym.rendering.scene import Snapshot

Curve = tuple[np.ndarray, np.ndarray]  # times (T,) [s] and entropies (T,) [bit]
REFERENCE_SIZE = (960, 640)  # pixels at which the lettering has its nominal size; other sizes scale it

_NO_SCREEN = "render_mode='human' needs a screen, and none was found; render_mode='rgb_array' draws without one"
_TICKS = {"color": scene.MUTED, "labelcolor": scene.TEXT, "labelsize": 6.5, "major.width": 0.7, "major.size": 3.0}
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 7.0,
    "text.color": scene.TEXT,
    "axes.edgecolor": scene.MUTED,
    "axes.linewidth": 0.7,
    "axes.labelcolor": scene.TEXT,
    **{f"{axis}tick.{name}": value for axis in "xy" for name, value in _TICKS.items()},
}
_BOX_ALPHA = 0.35  # how much of what is behind it a drawn box covers
_DASHED = (0, (4, 2))
_DRAWING = threading.Lock()  # environments of several threads share the pictures


def draw(snapshot: Snapshot, size: tuple[int, int] = REFERENCE_SIZE, beside: Sequence[Curve] = ()) -> np.ndarray:
    """The picture of a snapshot, (H, W, 3) uint8, for size = (W, H) in pixels.

    ``beside``: entropies of whole episodes, drawn up to the snapshot's time; they determine the axis of entropy.
    """
    with _DRAWING:
        picture = _offscreen_picture(int(size[0]), int(size[1]))
        picture.update(snapshot, beside)
        picture.figure.canvas.draw()
        return np.asarray(picture.figure.canvas.buffer_rgba())[..., :3].copy()


class Picture:
    """Three panels on one figure of matplotlib, whose artists are kept from frame to frame.

    ``make``: matplotlib's function that makes a figure of ``size`` (W, H) in pixels.
    """

    def __init__(self, make: Any, size: tuple[int, int]):
        dpi = 135 * min(np.array(size) / REFERENCE_SIZE)
        with style.context(["default", _STYLE]):  # whatever the user's settings are
            # A thousandth of a pixel more, since the canvas truncates.
            self.figure = figure = make(figsize=tuple((np.array(size) + 1e-3) / dpi), dpi=dpi)
            figure.set_facecolor("white")
            self._title = figure.text(0.022, 0.952, "", size=9.5, weight="bold", va="center")
            self._summary = figure.text(0.977, 0.952, "", size=8.0, va="center", ha="right")
            self._map = MapPanel(figure.add_axes((0.012, 0.115, 0.625, 0.79)))
            self._image = ImagePanel(figure.add_axes((0.682, 0.530, 0.295, 0.332)))
            self._entropy = EntropyPanel(figure.add_axes((0.682, 0.125, 0.295, 0.255)))
            handles = _map_legend()
            figure.legend(list(handles.values()), list(handles), loc="center", bbox_to_anchor=(0.325, 0.062), ncols=4,
                          frameon=False, fontsize=7.0, columnspacing=1.0, handletextpad=0.5)  # fmt: skip

    def update(self, snapshot: Snapshot, beside: Sequence[Curve] = ()) -> None:
        """Moves every artist to the snapshot; the caller draws the canvas. ``beside``: see `draw`."""
        error_cm = 100 * np.linalg.norm(snapshot.belief.position - snapshot.truth.position)
        mapped = f"{np.count_nonzero(snapshot.belief.mapped)} of {len(snapshot.truth.landmarks)}"
        self._title.set_text(f"{snapshot.scenario.name}   t = {snapshot.time:.1f} s")
        self._summary.set_text(f"{mapped} landmarks mapped   ·   position error {error_cm:.1f} cm")
        self._map.update(snapshot)
        self._image.update(snapshot)
        self._entropy.update(snapshot, beside)


@functools.lru_cache(maxsize=4)
def _offscreen_picture(width: int, height: int) -> Picture:
    """The picture of a size in pixels, kept: building a figure costs more than drawing one."""
    picture = Picture(Figure, (width, height))
    FigureCanvasAgg(picture.figure)
    return picture


class NoScreen(gymnasium.error.Error):
    """No window can be opened."""


class Window:
    """A window on the screen. Where a user has closed it, the run goes on without."""

    def __init__(self, size: tuple[int, int] = REFERENCE_SIZE):
        self.size = size
        self._picture: Picture | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draws the snapshot now; the first call opens the window. Raises NoScreen where there is none."""
        from matplotlib import pyplot

        self._picture = self._picture or self._opened()
        if pyplot.fignum_exists(self._picture.figure.number):
            self._picture.update(snapshot)
            self._picture.figure.canvas.draw()
            self._picture.figure.canvas.flush_events()

    def close(self) -> None:
        """Closes the window; harmless where none is open."""
        from matplotlib import pyplot

        if self._picture is not None:
            pyplot.close(self._picture.figure)
        self._picture = None

    def _opened(self) -> Picture:
        """A picture in a window. Raises NoScreen: none can be opened."""
        from matplotlib import pyplot
        from matplotlib.backend_bases import FigureManagerBase

        try:
            picture = Picture(pyplot.figure, self.size)
        except Exception as error:  # each GUI toolkit has its own way to say that there is no screen
            raise NoScreen(_NO_SCREEN) from error
        if type(picture.figure.canvas.manager) is FigureManagerBase:  # a backend without windows, such as Agg
            pyplot.close(picture.figure)
            raise NoScreen(_NO_SCREEN)
        picture.figure.canvas.manager.set_window_title("Active SLAM")
        picture.figure.show()
        return picture


class MapPanel:
    """The room, the belief's landmarks with their ellipsoids, the truth, both trajectories and both cameras."""

    def __init__(self, axes: Any):
        axes.set_axis_off()
        self._axes, self._floor = axes, 0.0
        self._planes = _shapes(axes, facecolors=[scene.FLOOR, scene.WALL, scene.WALL], zorder=0)
        self._grid = _segments(axes, colors=scene.GRID, linewidths=0.6, zorder=1)
        self._edges = _segments(axes, colors=scene.EXPECTED, linewidths=0.8, zorder=1)
        alignments = ("right", "center", "left")
        self._lengths = [axes.text(0, 0, "", color=scene.MUTED, size=7.0, ha=ha, va="top") for ha in alignments]
        self._boxes = _shapes(axes, linewidths=0.6, edgecolors=_faded([scene.MUTED], 0.7), zorder=2.5)
        self._floor_plan = _line(axes, ".", color=scene.MUTED, ms=1.6, mew=0.0, zorder=1.5)
        self._plumbs = _segments(axes, colors=scene.EXPECTED, linewidths=0.5, zorder=2)
        self._shadow = _line(axes, color=scene.EXPECTED, linewidth=1.0, zorder=2)
        self._expected = _line(axes, ".", color=scene.EXPECTED, ms=4.0, zorder=3)
        self._outlines = _shapes(axes, linewidths=0.9, zorder=4)
        self._circles = _segments(axes, linewidths=0.45, zorder=4)
        self._fiducials = _line(axes, "s", color=scene.FIDUCIAL, ms=4.4, mec=scene.TRUTH, mew=0.6, zorder=5)
        self._true_landmarks = _line(axes, "x", color=scene.TRUTH, ms=4.4, mew=0.9, zorder=5)
        self._mapped = _line(axes, "o", color=scene.MAPPED, ms=3.6, mec="white", mew=0.5, zorder=6)
        self._initialised = _line(axes, "o", ms=3.6, mfc="white", mec=scene.INITIALISED, zorder=6)
        self._true_path = _line(axes, color=scene.TRUTH, linewidth=0.9, linestyle=_DASHED, zorder=7)
        self._path = _line(axes, color=scene.CAMERA, linewidth=1.5, zorder=7)
        self._frustums = _shapes(axes, linewidths=[0.7] * 5 + [1.2] * 5, joinstyle="round", zorder=8)

    def update(self, snapshot: Snapshot) -> None:
        """Moves the artists."""
        self._update_room(np.array(snapshot.room_size, dtype=float))
        faces = scene.screen_from_world(scene.box_faces(snapshot.truth.boxes))
        colours = [scene.GRID, scene.MUTED, scene.EXPECTED] * len(snapshot.truth.boxes)
        self._boxes.set(verts=list(faces), facecolor=_faded(colours, _BOX_ALPHA))
        for artist, points in (
            (self._floor_plan, snapshot.floor_plan),
            (self._expected, snapshot.expected_landmarks),
            (self._fiducials, snapshot.truth.fiducials),
            (self._true_landmarks, snapshot.truth.landmarks),
            (self._mapped, snapshot.belief.landmarks[snapshot.belief.mapped]),
            (self._initialised, snapshot.belief.landmarks[~snapshot.belief.mapped]),
            (self._true_path, snapshot.true_trajectory),
            (self._path, snapshot.estimated_trajectory),
            (self._shadow, self._on_floor(snapshot.estimated_trajectory)),
        ):
            artist.set_data(*scene.screen_from_world(points).T)
        self._update_ellipsoids(snapshot)
        self._update_frustums(snapshot)

    def _update_room(self, size: np.ndarray) -> None:
        """Floor with a grid of 1 m (coarser in a hall), the two far walls, the near edges, the lengths.

        The room is centred, with one scale on both axes whatever the shape of the panel (a window may be resized).
        """
        edges = scene.screen_from_world(scene.room_edges(size))
        self._planes.set_verts(list(scene.screen_from_world(scene.room_planes(size))))
        self._grid.set_segments(scene.screen_from_world(scene.floor_grid(size)))
        self._edges.set_segments(edges)
        (x, y, z), off = size / 2, 0.025 * max(size)
        self._floor = -y
        places = scene.screen_from_world(np.array(((0, -y, -z - off), (x, -y - 0.6 * off, -z), (-x - off, -y, 0))))
        for artist, axis, length, place in zip(self._lengths, "XYZ", size, places):
            artist.set(text=f"{axis}  {length:g} m", position=place)
        low, high = edges.min((0, 1)), edges.max((0, 1))
        panel = np.array([self._axes.bbox.width, self._axes.bbox.height])
        half = panel * np.max(1.09 * (high - low) / panel) / 2
        left_bottom, right_top = (low + high) / 2 - half, (low + high) / 2 + half
        self._axes.set(xlim=(left_bottom[0], right_top[0]), ylim=(left_bottom[1], right_top[1]))

    def _update_ellipsoids(self, snapshot: Snapshot) -> None:
        """Outline and three great circles for each landmark and for the camera, far ones first."""
        means, covariances, colours = scene.believed_points(snapshot)
        order = np.argsort(means @ scene.TOWARDS_VIEWER)
        means, covariances, colours = means[order], covariances[order], colours[order]
        covariances = scene.shortened(covariances, scene.LONGEST / scene.ELLIPSOID_SIGMAS)
        outlines = scene.ellipsoid_outlines(means, covariances, scene.ELLIPSOID_SIGMAS)
        circles = scene.screen_from_world(scene.great_circles(means, covariances, scene.ELLIPSOID_SIGMAS))
        self._outlines.set(verts=outlines, facecolor=_faded(colours, 0.16), edgecolor=_faded(colours, 0.95))
        self._circles.set(segments=circles, color=_faded(np.repeat(colours, 3), 0.55))
        self._plumbs.set_segments(scene.screen_from_world(np.stack((means, self._on_floor(means)), axis=1)))

    def _update_frustums(self, snapshot: Snapshot) -> None:
        """The truth in faint black, then the estimate over it (left out where a lost filter has none)."""
        depth, faces, styles = 0.3 * min(snapshot.room_size), [], []
        for position, quaternion, style in (
            (snapshot.truth.position, snapshot.truth.quaternion, (scene.TRUTH, 0.0, 0.4)),
            (snapshot.belief.position, snapshot.belief.quaternion, (scene.CAMERA, 0.10, 1.0)),
        ):
            if np.isfinite(position).all() and np.isfinite(quaternion).all():
                faces += scene.camera_frustum(snapshot.scenario, position, quaternion, depth)
                styles += [style] * 5
        colours, face_alpha, edge_alpha = zip(*styles)
        verts = [scene.screen_from_world(face) for face in faces]
        self._frustums.set(verts=verts, facecolor=_faded(colours, face_alpha), edgecolor=_faded(colours, edge_alpha))

    def _on_floor(self, points: np.ndarray) -> np.ndarray:
        """The feet of points (n, 3) on the floor."""
        return points * (1, 0, 1) + (0, self._floor, 0)


class ImagePanel:
    """What the camera sees (u to the right, v down), what was predicted, and the command."""

    def __init__(self, axes: Any):
        axes.set(xticks=[], yticks=[], facecolor=scene.WALL, aspect="equal", anchor="S")
        axes.set_title("Image", loc="left", size=8.0, pad=5)
        self._axes = axes
        self._photo = axes.imshow(np.zeros((1, 1)), cmap="gray", vmin=0, vmax=255, visible=False, zorder=0)
        self._gates = _shapes(axes, facecolors=_faded([scene.MAPPED], 0.10), edgecolors=scene.MAPPED, linewidths=0.9)
        self._detections = _line(axes, "o", color=scene.TRUTH, ms=2.6, zorder=4)
        self._gaze = _line(axes, "<", color=scene.CAMERA, ms=8.0, zorder=5, clip_on=False)
        below = {"transform": axes.transAxes, "ha": "center", "va": "top"}
        self._command = axes.text(0.5, -0.055, "", size=8.0, weight="bold", color=scene.CAMERA, **below)
        predicted = _key("o", scene.MAPPED, 7, fill=False)
        _legend_above(axes, {"detected": _key("o", scene.TRUTH, 3.2), "predicted, 3σ": predicted})

    def update(self, snapshot: Snapshot) -> None:
        """Moves the artists to the snapshot."""
        width, height = float(snapshot.scenario.image_width), float(snapshot.scenario.image_height)
        self._photo.set_visible(snapshot.image is not None)
        if snapshot.image is not None:
            self._photo.set(data=snapshot.image, extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        self._axes.set(xlim=(0, width), ylim=(height, 0))
        self._gates.set_verts(scene.ellipses(*scene.predicted_pixels(snapshot), scene.GATE_SIGMAS))
        self._detections.set_data(*snapshot.detections.T)
        self._command.set_text(scene.command_text(snapshot.motion.name, snapshot.gaze.name))
        marker, place = {"LEFT": ("<", 0.035), "RIGHT": (">", 0.965)}.get(snapshot.gaze.name, ("", 0.5))
        self._gaze.set_marker(marker)
        self._gaze.set_data([place * width], [height / 2])


class EntropyPanel:
    """The entropy so far in bits, and when landmarks became mapped."""

    def __init__(self, axes: Any):
        axes.spines[["top", "right"]].set_visible(False)
        self._title = axes.set_title("Entropy", loc="left", size=8.0, pad=5)
        axes.set_xlabel("time (s)", size=7.0, labelpad=1)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_locator(MaxNLocator(4))
        self._axes, over_all = axes, axes.get_xaxis_transform()
        self._marks = _segments(axes, colors=scene.INITIALISED, linewidths=0.8, transform=over_all, zorder=1)
        self._beside = _segments(axes, colors=scene.MUTED, linewidths=1.0, zorder=2)
        self._curve = _line(axes, color=scene.MAPPED, linewidth=1.6, zorder=3)
        self._now = _line(axes, "o", color=scene.MAPPED, ms=4.5, zorder=4, clip_on=False)
        middle = {"transform": axes.transAxes, "ha": "center", "va": "center"}
        self._nothing = axes.text(0.5, 0.5, "no history kept", color=scene.MUTED, **middle)
        axes.set_ylabel("bits", size=7.0, labelpad=1)
        _legend_above(axes, {"mapped": _key("|", scene.INITIALISED, 8)})

    def update(self, snapshot: Snapshot, beside: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> None:
        """Moves the curve; the axis of time spans the whole episode, so that frames compare. ``beside``: see `draw`."""
        finite = np.isfinite(snapshot.entropy)
        times, entropy = snapshot.times[finite], snapshot.entropy[finite]
        self._curve.set_data(times, entropy)
        self._now.set_data(times[-1:], entropy[-1:])
        self._marks.set_segments([[(time, 0), (time, 1)] for time in snapshot.landmark_times])
        self._axes.set_xlim(0, max(snapshot.duration, snapshot.time, 1e-3))
        self._nothing.set_visible(len(entropy) == 0)
        self._axes.yaxis.set_visible(len(entropy) > 0)
        self._title.set_text(f"Entropy   {entropy[-1]:.0f} bits".replace("-", "−") if len(entropy) else "Entropy")
        self._beside.set_segments([np.column_stack(one)[one[0] <= snapshot.time] for one in beside])
        if len(entropy):
            shown = np.concatenate([entropy, *(bits[np.isfinite(bits)] for _, bits in beside)])
            pad = 0.08 * max(np.ptp(shown), 10.0)
            self._axes.set_ylim(shown.min() - pad, shown.max() + pad)


def _line(axes: Any, *marker: str, **style: Any) -> Any:
    """A line, or markers, without points yet."""
    return axes.plot([], [], *marker, **style)[0]


def _shapes(axes: Any, **style: Any) -> Any:
    """Polygons, none yet."""
    return axes.add_collection(PolyCollection([], **style))


def _segments(axes: Any, **style: Any) -> Any:
    """Lines of several segments, none yet."""
    return axes.add_collection(LineCollection([], **style))


def _key(marker: str, colour: str, size: float, fill: bool = True, edge: str = "", line: Any = "none") -> Line2D:
    """A sample for a legend."""
    face = colour if fill else _faded([colour], 0.18)[0]
    return Line2D([], [], marker=marker, color=colour, ms=size, ls=line, mfc=face, mec=edge or colour, mew=0.9)


def _legend_above(axes: Any, samples: dict[str, Line2D]) -> None:
    """The samples by their labels, in a row at the right over a panel."""
    axes.legend(list(samples.values()), list(samples), loc="lower right", bbox_to_anchor=(1.015, 0.99), frameon=False,
                fontsize=7, ncols=len(samples), columnspacing=1.0, handletextpad=0.1, borderpad=0.2)  # fmt: skip


def _map_legend() -> dict[str, Line2D]:
    """Samples by their labels, column by column: the belief, the truth, the prior, the camera."""
    return {
        "mapped, 2σ": _key("o", scene.MAPPED, 4.5),
        "initialising, 2σ": _key("o", scene.INITIALISED, 4.5, fill=False),
        "true landmark": _key("x", scene.TRUTH, 4.5),
        "expected": _key(".", scene.EXPECTED, 5),
        "fiducial": _key("s", scene.FIDUCIAL, 4.5, edge=scene.TRUTH),
        "floor shadow": _key("", scene.EXPECTED, 1, line="-"),
        "estimated camera": _key("", scene.CAMERA, 1, line="-"),
        "true camera": _key("", scene.TRUTH, 1, line=_DASHED),
    }


def _faded(colours, alpha) -> np.ndarray:
    """RGBA (n, 4) of colour names with an opacity, one or one each."""
    rgba = to_rgba_array(list(colours))
    rgba[:, 3] = alpha
    return rgba
