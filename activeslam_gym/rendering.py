"""Draws a snapshot: the map with its uncertainty, the camera's image, the entropy so far.

The only module that imports a drawing library, and only when something is drawn (the extra ``plot``).

The room is seen in orthographic projection, from behind and above the start, and not mirrored: the camera's left is
to the left. Under such a projection V (2 x 3), an ellipsoid of covariance P has an elliptic outline of covariance
V P Vᵀ, exactly; so the picture needs no 3-D engine, and a frame costs a few tens of milliseconds.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from activeslam_gym.envs.views import Snapshot

__all__ = ["Cockpit", "Window", "draw"]

CAMERA_DIMENSION = 12
"""Rows of the camera in the snapshot's covariance; three of each landmark follow."""

# Okabe and Ito's colours, safe for colour-blind readers: blue is believed, black is true, vermillion is the camera.
MAPPED, INITIALISED, EXPECTED = "#0072B2", "#7CC4F0", "#B0B4B8"
TRUTH, FIDUCIAL, CAMERA = "#1A1A1A", "#E69F00", "#D55E00"
TEXT, MUTED, GRID, FLOOR, WALL = "#1F2328", "#6B7280", "#DFE3E8", "#F3F5F7", "#F9FAFB"

REFERENCE_SIZE = (960, 640)
"""Pixels at which the lettering has its nominal size; other sizes scale it."""

COCKPIT_SIZE = (1360, 640)
"""Pixels of the window to fly in: the picture, and the actions' scores beside it."""

ELLIPSOID_SIGMAS, GATE_SIGMAS = 2.0, 3.0
"""Standard deviations drawn: of a landmark in the map, of a prediction in the image."""

STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.0,
    "text.color": TEXT,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.labelcolor": TEXT,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
}


def draw(snapshot: Snapshot, size: tuple[int, int] = REFERENCE_SIZE) -> np.ndarray:
    """The picture of a snapshot, (H, W, 3) uint8, for size = (W, H) in pixels.

    Raises gymnasium.error.DependencyNotInstalled where matplotlib is missing.
    """
    width, height = (int(pixels) for pixels in size)
    renderer = _offscreen_renderer(width, height)
    renderer.update(snapshot)
    canvas: Any = renderer.figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


class Window:
    """A window on the screen. A user who closes it is not shown another: the run goes on without."""

    def __init__(self, size: tuple[int, int] = REFERENCE_SIZE):
        self.size = size
        self._renderer: Renderer | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draws the snapshot now; the first call opens the window.

        Raises gymnasium.error.Error where there is no screen, DependencyNotInstalled where matplotlib is missing.
        """
        if self._renderer is None:
            self._figure = _figure_in_window(
                self.size, "render_mode='human' needs a screen and none was found; use render_mode='rgb_array' instead"
            )
            self._renderer = Renderer(self._figure)
        figure = self._figure
        if not _pyplot().fignum_exists(figure.number):
            return
        self._renderer.update(snapshot)
        figure.canvas.draw()
        figure.canvas.flush_events()

    def close(self) -> None:
        """Closes the window; harmless where none is open."""
        if self._renderer is not None:
            _pyplot().close(self._figure)
        self._renderer = None


class Cockpit:
    """A window to fly in: the picture, what every action promises, and the keys that are pressed in it.

    Args:
        actions: A label for each score, in groups.
        size: Of the window in pixels.

    Raises:
        gymnasium.error.Error: there is no screen.
        gymnasium.error.DependencyNotInstalled: matplotlib is missing.
    """

    def __init__(self, actions: Sequence[Sequence[str]], size: tuple[int, int] = COCKPIT_SIZE):
        self._figure = figure = _figure_in_window(size, "flying by hand needs a screen and none was found")
        with _matplotlib().style.context(["default", STYLE]):
            ratios = (REFERENCE_SIZE[0], COCKPIT_SIZE[0] - REFERENCE_SIZE[0])
            halves: Any = figure.subfigures(1, 2, width_ratios=ratios)
            picture, beside = halves
            self._renderer = Renderer(picture)
            self._scores = ScorePanel(beside, actions)
        self._pressed: list[str] = []
        own_keys = getattr(figure.canvas.manager, "key_press_handler_id", None)
        if own_keys is not None:  # matplotlib's own, among them the arrows and "q"
            figure.canvas.mpl_disconnect(own_keys)
        figure.canvas.mpl_connect(
            "key_press_event", lambda event: self._pressed.append(getattr(event, "key", "") or "")
        )

    @property
    def is_open(self) -> bool:
        """False once the user has closed the window."""
        return bool(_pyplot().fignum_exists(self._figure.number))

    def show(self, snapshot: Snapshot, scores: Mapping[str, np.ndarray], chosen: Iterable[int], caption: str) -> None:
        """Draws now: the scores by their title, the chosen actions marked, and a line of text."""
        if self.is_open:
            self._renderer.update(snapshot)
            self._scores.update(scores, chosen, caption)
            self._figure.canvas.draw()

    def keys(self, seconds: float) -> list[str]:
        """The keys pressed since the last call, after waiting so long for more; matplotlib's names."""
        if self.is_open:
            self._figure.canvas.start_event_loop(seconds)
        pressed, self._pressed = self._pressed, []
        return pressed

    def close(self) -> None:
        """Closes the window; harmless where it is closed."""
        _pyplot().close(self._figure)


class Renderer:
    """Three panels on one figure, whose artists are kept from frame to frame."""

    def __init__(self, figure: Figure | SubFigure):
        self.figure = figure
        with _matplotlib().style.context(["default", STYLE]):
            figure.set_facecolor("white")
            self._title = figure.text(0.022, 0.952, "", size=11.5, weight="bold", va="center")
            self._summary = figure.text(0.977, 0.952, "", size=9.5, va="center", ha="right")
            self._panels = (
                MapPanel(figure.add_axes((0.012, 0.115, 0.625, 0.79))),
                ImagePanel(figure.add_axes((0.682, 0.530, 0.295, 0.332))),
                EntropyPanel(figure.add_axes((0.682, 0.115, 0.295, 0.275))),
            )
            figure.legend(**_map_legend(), loc="center", bbox_to_anchor=(0.325, 0.062), frameon=False, fontsize=7.5,
                          ncols=4, columnspacing=1.8, handletextpad=0.6, labelspacing=0.55)  # fmt: skip

    def update(self, snapshot: Snapshot) -> None:
        """Moves every artist to the snapshot; the caller draws the canvas."""
        error_cm = 100 * np.linalg.norm(snapshot.position - snapshot.true_position)
        self._title.set_text(f"Active SLAM   t = {snapshot.time:.1f} s")
        self._summary.set_text(
            f"{np.count_nonzero(snapshot.mapped)} of {len(snapshot.true_landmarks)} landmarks mapped"
            f"   ·   position error {error_cm:.1f} cm"
        )
        for panel in self._panels:
            panel.update(snapshot)


class MapPanel:
    """The room, the belief's landmarks with their ellipsoids, the truth, both trajectories and both cameras."""

    def __init__(self, axes: Axes):
        from matplotlib.collections import LineCollection, PolyCollection

        axes.set_axis_off()
        self._axes = axes
        self._room_size = np.zeros(3)
        self._room_artists: list[Any] = []
        self._plumbs = _added(axes, LineCollection([], colors=EXPECTED, linewidths=0.5, zorder=2))
        self._shadow = _line(axes, color=EXPECTED, linewidth=1.0, zorder=2)
        self._expected = _markers(axes, ".", color=EXPECTED, markersize=5.0, zorder=3)
        self._outlines = _added(axes, PolyCollection([], linewidths=0.9, zorder=4))
        self._circles = _added(axes, LineCollection([], linewidths=0.45, zorder=4))
        self._fiducials = _markers(axes, "s", color=FIDUCIAL, markeredgecolor=TRUTH, markeredgewidth=0.6, zorder=5)
        self._true_landmarks = _markers(axes, "x", color=TRUTH, markersize=4.0, markeredgewidth=0.9, zorder=6)
        self._true_path = _line(axes, color=TRUTH, linewidth=0.9, linestyle=(0, (4, 2)), zorder=7)
        self._path = _line(axes, color=CAMERA, linewidth=1.5, zorder=7)
        self._frustums = _added(axes, PolyCollection([], linewidths=[0.7] * 5 + [1.2] * 5, joinstyle="round", zorder=8))

    def update(self, snapshot: Snapshot) -> None:
        """Moves the artists; builds the room again where its size has changed."""
        if not np.array_equal(self._room_size, snapshot.room_size):
            self._build_room(np.array(snapshot.room_size, dtype=float))
        for artist, points in (
            (self._expected, snapshot.expected_landmarks),
            (self._fiducials, snapshot.fiducials),
            (self._true_landmarks, snapshot.true_landmarks),
            (self._true_path, snapshot.true_trajectory),
            (self._path, snapshot.estimated_trajectory),
            (self._shadow, self._on_floor(snapshot.estimated_trajectory)),
        ):
            artist.set_data(*screen_from_world(points).T)
        self._update_ellipsoids(snapshot)
        self._update_frustums(snapshot)
        self._fit_room()

    def _update_ellipsoids(self, snapshot: Snapshot) -> None:
        """Outline and three great circles for each finite landmark and for the camera, far ones first."""
        means = np.concatenate((np.reshape(snapshot.landmarks, (-1, 3)), snapshot.position[None]))
        covariances = np.concatenate((landmark_covariances(snapshot.covariance), snapshot.covariance[None, :3, :3]))
        colours = np.array([MAPPED if mapped else INITIALISED for mapped in snapshot.mapped] + [CAMERA])
        finite = np.isfinite(means).all(1) & np.isfinite(covariances).all((1, 2))
        order = np.flatnonzero(finite)
        order = order[np.argsort(means[order] @ TOWARDS_VIEWER)]
        means, covariances, colours = means[order], covariances[order], colours[order]

        self._outlines.set_verts(ellipses(screen_from_world(means), VIEW @ covariances @ VIEW.T, ELLIPSOID_SIGMAS))
        self._outlines.set_facecolor(_faded(colours, 0.16))
        self._outlines.set_edgecolor(_faded(colours, 0.95))
        self._circles.set_segments(screen_from_world(great_circles(means, covariances, ELLIPSOID_SIGMAS)))
        self._circles.set_color(_faded(np.repeat(colours, 3), 0.55))
        self._plumbs.set_segments(screen_from_world(np.stack((means, self._on_floor(means)), axis=1)))

    def _update_frustums(self, snapshot: Snapshot) -> None:
        """The truth in faint black, then the estimate over it (left out where a lost filter has none)."""
        depth = 0.3 * min(snapshot.room_size)
        faces: list[np.ndarray] = []
        styles: list[tuple[str, float, float]] = []
        for position, quaternion, style in (
            (snapshot.true_position, snapshot.true_quaternion, (TRUTH, 0.0, 0.4)),
            (snapshot.position, snapshot.quaternion, (CAMERA, 0.10, 1.0)),
        ):
            if np.isfinite(position).all() and np.isfinite(quaternion).all():
                faces += camera_frustum(snapshot.scenario, snapshot.image_size, position, quaternion, depth)
                styles += [style] * 5
        colours, face_alpha, edge_alpha = zip(*styles)
        self._frustums.set_verts([screen_from_world(face) for face in faces])
        self._frustums.set_facecolor(_faded(colours, face_alpha))
        self._frustums.set_edgecolor(_faded(colours, edge_alpha))

    def _on_floor(self, points: np.ndarray) -> np.ndarray:
        """The feet of points (n, 3) on the floor."""
        floor = -self._room_size[1] / 2
        return np.reshape(points, (-1, 3)) * (1, 0, 1) + (0, floor, 0)

    def _build_room(self, size: np.ndarray) -> None:
        """Floor with a grid of 1 m (coarser in a hall), the two far walls, the near edges, the lengths."""
        from matplotlib.collections import LineCollection, PolyCollection

        for artist in self._room_artists:
            artist.remove()
        self._room_size = size
        planes = PolyCollection(list(screen_from_world(_room_planes(size))), facecolors=[FLOOR, WALL, WALL], zorder=0)
        grid = LineCollection(list(screen_from_world(_floor_grid(size))), colors=GRID, linewidths=0.6, zorder=1)
        edges = LineCollection(list(screen_from_world(_room_edges(size))), colors=EXPECTED, linewidths=0.8, zorder=1)
        self._room_artists = [_added(self._axes, artist) for artist in (planes, grid, edges)]
        for place, text, alignment in _room_labels(size):
            x, y = screen_from_world(place)
            self._room_artists.append(self._axes.text(x, y, text, color=MUTED, size=7.5, ha=alignment, va="top"))

    def _fit_room(self) -> None:
        """Centres the room, with one scale on both axes whatever the shape of the panel (a window may be resized)."""
        corners = screen_from_world(_room_edges(self._room_size)).reshape(-1, 2)
        centre, extent = (corners.max(0) + corners.min(0)) / 2, 1.09 * np.ptp(corners, axis=0)
        panel = np.array([self._axes.bbox.width, self._axes.bbox.height])
        half = panel * np.max(extent / panel) / 2
        self._axes.set(xlim=centre[0] + half[0] * np.array([-1, 1]), ylim=centre[1] + half[1] * np.array([-1, 1]))


class ImagePanel:
    """What the camera sees (u to the right, v down), what was predicted, and the command."""

    def __init__(self, axes: Axes):
        from matplotlib.collections import PolyCollection

        axes.set(xticks=[], yticks=[], facecolor=WALL, aspect="equal", anchor="S")
        axes.set_title("Camera image", loc="left", size=9.5, pad=6)
        self._axes = axes
        self._gates = _added(
            axes, PolyCollection([], facecolors=_faded([MAPPED], 0.10), edgecolors=MAPPED, linewidths=0.9)
        )
        self._detections = _markers(axes, "o", color=TRUTH, markersize=3.2, zorder=4)
        self._gaze = _markers(axes, "<", color=CAMERA, markersize=9, zorder=5, clip_on=False)
        self._command = axes.text(0.5, -0.055, "", transform=axes.transAxes, size=9.5, weight="bold", color=CAMERA,
                                  ha="center", va="top")  # fmt: skip
        key = [_key("o", TRUTH, 3.2), _key("o", MAPPED, 7, fill=False)]
        axes.legend(key, ["detected", "predicted, 3σ"], loc="lower right", bbox_to_anchor=(1.015, 0.99), ncols=2,
                    frameon=False, fontsize=7, columnspacing=1.0, handletextpad=0.1, borderpad=0.2)  # fmt: skip

    def update(self, snapshot: Snapshot) -> None:
        """Moves the artists to the snapshot."""
        width, height = (float(pixels) for pixels in snapshot.image_size)
        self._axes.set(xlim=(0, width), ylim=(height, 0))
        means, covariances = (
            np.reshape(snapshot.predicted, (-1, 2)),
            np.reshape(snapshot.predicted_covariance, (-1, 2, 2)),
        )
        finite = np.isfinite(means).all(1) & np.isfinite(covariances).all((1, 2))
        self._gates.set_verts(ellipses(means[finite], covariances[finite], GATE_SIGMAS))
        self._detections.set_data(*np.reshape(snapshot.detections, (-1, 2)).T)
        self._command.set_text(command_text(snapshot.motion.name, snapshot.gaze.name))
        side = {"LEFT": ("<", 0.035 * width), "RIGHT": (">", 0.965 * width)}.get(snapshot.gaze.name)
        self._gaze.set_visible(side is not None)
        if side is not None:
            self._gaze.set_marker(side[0])
            self._gaze.set_data([side[1]], [height / 2])


class EntropyPanel:
    """The entropy so far in bits, and when landmarks became mapped."""

    def __init__(self, axes: Axes):
        from matplotlib.collections import LineCollection
        from matplotlib.ticker import MaxNLocator

        axes.spines[["top", "right"]].set_visible(False)
        self._title = axes.set_title("Entropy", loc="left", size=9.5, pad=6)
        axes.set_ylabel("bits", size=8, labelpad=1)
        axes.set_xlabel("time (s)", size=8, labelpad=2)
        axes.xaxis.set_major_locator(MaxNLocator(7))
        axes.yaxis.set_major_locator(MaxNLocator(4))
        axes.tick_params(labelcolor=TEXT)
        self._axes = axes
        self._marks = _added(
            axes, LineCollection([], colors=INITIALISED, linewidths=0.8, transform=axes.get_xaxis_transform(), zorder=1)
        )
        self._curve = _line(axes, color=MAPPED, linewidth=1.6, zorder=3)
        self._now = _markers(axes, "o", color=MAPPED, markersize=4.5, zorder=4, clip_on=False)
        self._nothing = axes.text(
            0.5, 0.5, "no history kept", transform=axes.transAxes, color=MUTED, ha="center", va="center"
        )
        axes.legend([_key("|", INITIALISED, 8)], ["landmark mapped"], loc="lower right", bbox_to_anchor=(1.015, 0.99),
                    frameon=False, fontsize=7, handletextpad=0.1, borderpad=0.2)  # fmt: skip

    def update(self, snapshot: Snapshot) -> None:
        """Moves the curve; the axis of time spans the whole episode, so that frames compare."""
        times, entropy = np.reshape(snapshot.times, -1), np.reshape(snapshot.entropy, -1)
        finite = np.isfinite(entropy)
        times, entropy = times[finite], entropy[finite]
        self._curve.set_data(times, entropy)
        self._now.set_data(times[-1:], entropy[-1:])
        self._marks.set_segments([[(time, 0), (time, 1)] for time in np.reshape(snapshot.landmark_times, -1)])
        self._axes.set_xlim(0, max(snapshot.duration, snapshot.time, 1e-3))
        self._nothing.set_visible(len(entropy) == 0)
        self._axes.yaxis.set_visible(len(entropy) > 0)
        self._title.set_text(f"Entropy   {entropy[-1]:.0f} bits".replace("-", "−") if len(entropy) else "Entropy")
        if len(entropy):
            pad = 0.08 * max(np.ptp(entropy), 10.0)
            self._axes.set_ylim(entropy.min() - pad, entropy.max() + pad)


class ScorePanel:
    """A bar for each action under each of two criteria; the chosen actions are marked, the best numbers bold.

    Actions come in groups (motions, gazes), each with a scale of its own: they look ahead over different times.
    """

    _COLUMNS = ((0.30, 0.27), (0.66, 0.27))
    """Left edge and width of the two columns."""

    def __init__(self, figure: Figure | SubFigure, groups: Sequence[Sequence[str]]):
        figure.set_facecolor("white")
        figure.text(0.02, 0.952, "What each action promises", size=11.5, weight="bold", va="center")
        self._caption = figure.text(0.02, 0.062, "", size=9.5, va="center", wrap=True)
        self._group = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        places = -np.arange(len(self._group)) - 0.6 * self._group
        self._columns = []
        for left, width in self._COLUMNS:
            axes = figure.add_axes((left, 0.115, width, 0.745))
            axes.set(yticks=[], xticks=[], xlim=(0.0, 1.45), ylim=(places[-1] - 0.6, 0.6))
            axes.spines[["top", "right", "bottom"]].set_visible(False)
            bars = list(axes.barh(places, np.zeros(len(places)), height=0.62))
            numbers = [axes.text(0.0, y, "", size=7.5, va="center") for y in places]
            self._columns.append((axes, bars, numbers))
        first = self._columns[0][0]
        names = [name for group in groups for name in group]
        self._names = [
            first.text(-0.06, y, name, size=8, ha="right", va="center") for y, name in zip(places, names, strict=True)
        ]

    def update(self, scores: Mapping[str, np.ndarray], chosen: Iterable[int], caption: str) -> None:
        """Moves the bars, of titles and values (n,) of all groups in a row."""
        marked = set(chosen)
        for (axes, bars, numbers), (title, values) in zip(self._columns, scores.items(), strict=True):
            axes.set_title(title, loc="left", size=8, pad=4)
            finite = np.where(np.isfinite(values), values, 0.0)
            greatest = np.array([finite[self._group == group].max() for group in self._group])
            lengths = np.maximum(finite, 0.0) / np.maximum(greatest, 1e-12)
            for i, (bar, number) in enumerate(zip(bars, numbers, strict=True)):
                bar.set_width(lengths[i])
                bar.set_color(CAMERA if i in marked else INITIALISED)
                number.set_text(f"{values[i]:.3g}")
                number.set_x(lengths[i] + 0.04)
                number.set_fontweight("bold" if finite[i] == greatest[i] else "normal")
        for i, name in enumerate(self._names):
            name.set_color(CAMERA if i in marked else TEXT)
            name.set_fontweight("bold" if i in marked else "normal")
        self._caption.set_text(caption)


# ---------------------------------------------------------------------------------------------------------- geometry


def view_axes(azimuth: float, elevation: float) -> np.ndarray:
    """Rows right, up, towards the viewer, (3, 3), of a viewer behind the start (at -Z) and above it; radians.

    A positive azimuth moves the viewer to the right, which is -X, since the camera's x points left.
    """
    towards = np.array([-np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)])
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(towards, right), towards))


VIEW, TOWARDS_VIEWER = np.split(view_axes(np.deg2rad(25.0), np.deg2rad(37.0)), [2])
TOWARDS_VIEWER = TOWARDS_VIEWER[0]


def screen_from_world(points: np.ndarray) -> np.ndarray:
    """Orthographic projection of world points (..., 3) in metres to the page (..., 2), in metres too."""
    points = np.asarray(points, dtype=float)
    return points.reshape(*points.shape[:-1], 3) @ VIEW.T if points.size else np.zeros((0, 2))


def landmark_covariances(covariance: np.ndarray) -> np.ndarray:
    """The landmarks' own blocks (n, 3, 3), m², of the joint covariance (12 + 3n, 12 + 3n)."""
    part = covariance[CAMERA_DIMENSION:, CAMERA_DIMENSION:]
    count = len(part) // 3
    return part.reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count), :]


def principal_axes(covariances: np.ndarray) -> np.ndarray:
    """A (n, d, d) with A Aᵀ = P, its columns the semi-axes of one sigma; tiny negative eigenvalues count as zero."""
    eigenvalues, eigenvectors = np.linalg.eigh(covariances)
    return eigenvectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]


def ellipses(means: np.ndarray, covariances: np.ndarray, sigmas: float, points: int = 48) -> np.ndarray:
    """Outlines (n, points, 2) of the ellipses of means (n, 2) and covariances (n, 2, 2), at so many sigmas."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    return means[:, None] + sigmas * np.swapaxes(principal_axes(covariances) @ circle, 1, 2)


def great_circles(means: np.ndarray, covariances: np.ndarray, sigmas: float, points: int = 32) -> np.ndarray:
    """Three principal circles (3n, points, 3) on each ellipsoid of means (n, 3), covariances (n, 3, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros(points)
    circles = np.array([(cosine, sine, zero), (zero, cosine, sine), (sine, zero, cosine)])
    on_ellipsoid = np.swapaxes(principal_axes(covariances)[:, None] @ circles, 2, 3)
    return (means[:, None, None] + sigmas * on_ellipsoid).reshape(-1, points, 3)


def camera_frustum(scenario, image_size, position, quaternion, depth: float) -> list[np.ndarray]:
    """Four triangles (3, 3) and the image rectangle (4, 3) in the world, m: a pinhole's view, distortion left out.

    `position` (3,) p_WC in m, `quaternion` (4,) q_WC, scalar first, `depth` of the rectangle in m.
    """
    from scipy.spatial.transform import Rotation

    width, height = image_size
    u, v = np.array([0, width, width, 0]), np.array([0, 0, height, height])
    # x left and y up, while u grows to the right and v downwards.
    x, y = (scenario.principal_x_px - u) / scenario.focal_px, (scenario.principal_y_px - v) / scenario.focal_px
    corners_C = depth * np.stack((x, y, np.ones(4)), axis=1)
    corners_W = position + Rotation.from_quat(quaternion, scalar_first=True).apply(corners_C)
    return [np.stack((position, corners_W[i], corners_W[i - 1])) for i in range(4)] + [corners_W]


def _box_corner(size: np.ndarray, x: int, y: int, z: int) -> np.ndarray:
    """The corner (3,) of the room at the given signs."""
    return np.array([x, y, z]) * size / 2


def _room_planes(size: np.ndarray) -> np.ndarray:
    """Floor, far wall (+Z) and left wall (+X), (3, 4, 3): what the viewer sees from within."""
    signs = [
        [(-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)],
        [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
        [(1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)],
    ]
    return np.array([[_box_corner(size, *corner) for corner in plane] for plane in signs])


def _room_edges(size: np.ndarray) -> np.ndarray:
    """The edges (9, 2, 3) of those planes; the three that would cross the foreground are left out."""
    edges = {
        tuple(sorted((tuple(plane[i]), tuple(plane[i - 1])))) for plane in _room_planes(size).tolist() for i in range(4)
    }
    return np.array(sorted(edges))


def _floor_grid(size: np.ndarray) -> np.ndarray:
    """Lines (k, 2, 3) on the floor, 1 m apart, or as many metres as keep them fewer than about twenty."""
    spacing = max(1.0, np.ceil(max(size) / 20))
    half_x, floor, half_z = size[0] / 2, -size[1] / 2, size[2] / 2
    xs, zs = (np.arange(np.ceil(-half / spacing), half / spacing) * spacing for half in (half_x, half_z))
    along_z = [[(x, floor, -half_z), (x, floor, half_z)] for x in xs]
    along_x = [[(-half_x, floor, z), (half_x, floor, z)] for z in zs]
    return np.array(along_z + along_x)


def _room_labels(size: np.ndarray) -> list[tuple[np.ndarray, str, str]]:
    """(place (3,), text, horizontal alignment) of the lengths, beside the near edges."""
    half, off = size / 2, 0.025 * max(size)
    return [
        (np.array([0, -half[1], -half[2] - off]), f"X  {size[0]:g} m", "right"),
        (np.array([-half[0] - off, -half[1], 0]), f"Z  {size[2]:g} m", "left"),
        (np.array([half[0], -half[1] - 0.6 * off, -half[2]]), f"Y  {size[1]:g} m", "center"),
    ]


def command_text(motion: str, gaze: str) -> str:
    """'⊗ FORWARD · gaze LEFT': an arrow as seen in the image, ⊗ into it and ⊙ out of it, and the command's names."""
    arrow = {"FORWARD": "⊗ ", "BACKWARDS": "⊙ ", "RIGHT": "→ ", "LEFT": "← ", "UP": "↑ ", "DOWN": "↓ "}.get(motion, "")
    return f"{arrow}{motion} · gaze {gaze}"


# -------------------------------------------------------------------------------------------------------- matplotlib


def _matplotlib() -> ModuleType:
    """The library, or an error that says how to get it."""
    try:
        import matplotlib
        import matplotlib.style
    except ImportError as error:
        raise gymnasium.error.DependencyNotInstalled(
            'matplotlib is needed to render: pip install "activeslam-gym[plot]"'
        ) from error
    return matplotlib


@functools.lru_cache(maxsize=4)
def _offscreen_renderer(width: int, height: int) -> Renderer:
    """The renderer of a size in pixels, kept: building a figure costs more than drawing one."""
    _matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**_figure_shape(width, height))
    FigureCanvasAgg(figure)
    return Renderer(figure)


def _figure_shape(width: int, height: int) -> dict[str, Any]:
    """matplotlib's figsize (inches) and dpi for a size in pixels."""
    dpi = 100 * min(width / REFERENCE_SIZE[0], height / REFERENCE_SIZE[1])
    # A thousandth of a pixel more, since the canvas truncates.
    return {"figsize": ((width + 1e-3) / dpi, (height + 1e-3) / dpi), "dpi": dpi}


def _pyplot() -> ModuleType:
    """matplotlib's interface with windows; nothing but `Window` needs it."""
    _matplotlib()
    import matplotlib.pyplot

    return matplotlib.pyplot


def _figure_in_window(size: tuple[int, int], hint: str) -> Figure:
    """A figure in a window of its own; where none can be opened, an error that says `hint`."""
    pyplot = _pyplot()
    from matplotlib.backend_bases import FigureManagerBase

    try:
        figure = pyplot.figure(**_figure_shape(*size))
    except Exception as error:  # each GUI toolkit has its own way to say that there is no screen
        raise gymnasium.error.Error(hint) from error
    if type(figure.canvas.manager) is FigureManagerBase:  # a backend without windows, such as Agg
        pyplot.close(figure)
        raise gymnasium.error.Error(hint)
    figure.canvas.manager.set_window_title("Active SLAM")
    figure.show()
    return figure


def _added(axes: Axes, collection: Any) -> Any:
    """The collection, on these axes (what `add_collection` returns, without its narrower type)."""
    axes.add_collection(collection)
    return collection


def _line(axes: Axes, **properties: Any):
    """A line without points yet."""
    return axes.plot([], [], **properties)[0]


def _markers(axes: Axes, marker: str, **properties: Any):
    """Markers without points yet."""
    return axes.plot([], [], marker, **({"markersize": 5.5} | properties))[0]


def _key(marker: str, colour: str, size: float, *, fill: bool = True, edge: str | None = None, line: Any = "none"):
    """A sample for a legend."""
    from matplotlib.lines import Line2D

    face = _faded([colour], 0.18)[0] if not fill else colour
    return Line2D([], [], marker=marker, color=colour, markersize=size, linestyle=line, markerfacecolor=face,
                  markeredgecolor=edge or colour, markeredgewidth=0.9)  # fmt: skip


def _map_legend() -> dict[str, list]:
    """Handles and labels, column by column: the belief, the truth, the prior, the camera."""
    entries = {
        "mapped landmark, 2σ": _key("o", MAPPED, 8, fill=False),
        "being initialised, 2σ": _key("o", INITIALISED, 8, fill=False),
        "true landmark": _key("x", TRUTH, 4.5),
        "expected landmark": _key(".", EXPECTED, 6),
        "fiducial": _key("s", FIDUCIAL, 5.5, edge=TRUTH),
        "floor shadow": _key("", EXPECTED, 1, line="-"),
        "estimated camera": _key("", CAMERA, 1, line="-"),
        "true camera": _key("", TRUTH, 1, line=(0, (4, 2))),
    }
    return {"handles": list(entries.values()), "labels": list(entries)}


def _faded(colours, alpha) -> np.ndarray:
    """RGBA (n, 4) of colour names with an opacity, one or one each."""
    from matplotlib.colors import to_rgba_array

    rgba = to_rgba_array(list(colours))
    rgba[:, 3] = alpha
    return rgba
