"""The page, in a process of its own: the map in three dimensions, the camera's view, the command and its reasons.

viser (the extra `live`) serves the same page to every browser, behind a `guard`. It refuses requests for a public
tunnel, and it writes no file of this machine.
"""

import logging
import signal
import sys
import threading
import time
from collections.abc import Callable
from html import escape
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from activeslam_gym.geometry import quaternion_product, rotation_matrix
from activeslam_gym.live import drawing
from activeslam_gym.live.drawing import BLUE, CURVES, NAMES, ORANGE, SIGNS, SKY, VERMILLION, rgb
from activeslam_gym.live.guard import Guard, guarding
from activeslam_gym.live.history import History
from activeslam_gym.live.messages import FOLLOW, MARK, PAUSE, RESTART, SAVE, STEP, About
from activeslam_gym.live.state import State
from activeslam_gym.motion import Motion
from activeslam_gym.vision.track import map_table

SIGMAS = 2.0
"""Of the ellipsoids in the map."""
_CAPACITY = 64
"""Ellipsoids: more than there are features."""
_LONGEST = 0.6
"""Greatest half-length of an ellipsoid [m]; a new feature's depth is hardly known."""
_NOWHERE = (0.0, -1e3, 0.0)
_OFTEN, _SELDOM = 1.0 / 16.0, 0.5
"""Least time between two pictures, and between two drawings of curves and bars [s]."""
_AHEAD = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 0.3)]], np.float32)
_HALF_TURN = np.array((0.0, 0.0, 0.0, 1.0))
"""From the filter's camera, x left and y up, to the page's, x right and y down."""
_WAYS = {Motion.FORWARD: (0, 0, 1), Motion.BACKWARDS: (0, 0, -1), Motion.RIGHT: (-1, 0, 0), Motion.LEFT: (1, 0, 0),
         Motion.UP: (0, 1, 0), Motion.DOWN: (0, -1, 0), Motion.STAY: (0, 0, 0)}  # fmt: skip
"""Directions of the motions in the filter's camera axes."""
_ON_A_PHONE = """<style>@media (max-width: 576px) {
.mantine-Paper-root[style*="60%"], .mantine-Paper-root[style*="60%"] div[style*="20em"] { width: 100% !important; }
}</style>"""
"""The sheet below the map takes the whole width, of which viser's own leaves a third."""


def viser() -> Any:
    """The module `viser`.

    Raises:
        ModuleNotFoundError: it is not installed; the message names the extra.
    """
    try:
        import viser
    except ModuleNotFoundError:
        raise ModuleNotFoundError("viser is needed to serve the page: install the extra `live`") from None
    return viser


class Page:
    """Serves the page at ``host`` and ``port``; a button calls ``request(name, value)``, see `messages`.

    Raises:
        ModuleNotFoundError: viser is not installed.
        OSError: the installed viser cannot be guarded.
    """

    def __init__(self, about: About, host: str, port: int, request: Callable[[str, Any], None]) -> None:
        self._about, self._request = about, request
        self._paused, self._history = False, History()
        self._state: State | None = None
        self._shown, self._drawn = 0.0, 0.0
        self._command_shown: int | None = None
        guard = Guard.of(host)
        self._server = _quiet_server(host, port, guard)
        self.address = guard.address(host, self._server.get_port())
        """Address of the page, with its token."""
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(BLUE), control_width="large")
        gui.set_panel_label("Where to move")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        self._add_guide(gui)
        self._add_left_panels(gui)
        self._add_map(self._server.scene)
        self._eye: np.ndarray | None = None
        self._aim: np.ndarray | None = None
        self._server.on_client_connect(self._place_viewer)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    # Its elements -----------------------------------------------------------------------------------------------------

    def _add_guide(self, gui: Any) -> None:
        """Add the command, the view and the reasons."""
        gui.add_html(_ON_A_PHONE)
        self._command = gui.add_html(f'<div style="font-size:20px">{escape(self._about.name)} …</div>')
        self._standing = gui.add_html("")
        width, height = self._about.image_size
        self._view = gui.add_image(np.zeros((drawing.SCALE * height, drawing.SCALE * width, 3), np.uint8))
        self._set(gui.add_html(""), drawing.legend())
        self._why = gui.add_html("")

    def _add_buttons(self, gui: Any) -> None:
        icons = viser().Icon
        self._pause = gui.add_button("Pause", icon=icons.PLAYER_PAUSE)
        self._pause.on_click(lambda _: self._set_paused(not self._paused))
        step = gui.add_button("Single step", icon=icons.PLAYER_SKIP_FORWARD)
        step.on_click(lambda _: self._step())
        restart = gui.add_button("Restart", icon=icons.REFRESH)
        restart.on_click(lambda _: self._request(RESTART, True))
        if self._about.person:
            follow = gui.add_checkbox("Follow the advice", True)
            follow.on_update(lambda event: self._request(FOLLOW, follow.value) if event.client is not None else None)
            self._follow = follow
        if not self._about.replay:
            mark = gui.add_button("Mark what is in the middle", icon=icons.CROSSHAIR)
            mark.on_click(lambda _: self._mark_middle())
        self._marked = gui.add_html("")
        save = gui.add_button("Save", icon=icons.DEVICE_FLOPPY, hint="The map, to this browser and to the recording")
        save.on_click(self._save)

    def _add_left_panels(self, gui: Any) -> None:
        """Add figure 5 of the paper and the controls beside the map."""
        panel = gui.add_panel()
        with panel.add_tab("What is known"):
            self._counts = gui.add_html("")
            self._add_curves(gui)
            self._commands = gui.add_html("")
        panel.dock_left()
        panel.set_width(330)
        controls = gui.add_panel()
        with controls.add_tab("Controls"):
            self._add_buttons(gui)
        controls.dock_below(panel)

    def _add_curves(self, gui: Any) -> None:
        """Add the entropies over time: lines, and a dot on the total where a landmark is new."""
        plot = viser().uplot
        self._set(gui.add_html(""), drawing.title("Entropy, log₂ |P|", "the lower, the more is known"))
        lines = (plot.Series(label=name, stroke=colour, width=1.8) for name, colour in CURVES.items())
        dots = plot.Series(label="new landmark", stroke=ORANGE, width=0.0, points={"show": True, "fill": ORANGE})
        self._curves = gui.add_uplot(
            (np.zeros(0),) * 5,
            (plot.Series(label="s"), *lines, dots),
            scales={"x": plot.Scale(time=False)},
            aspect=1.7,
            axes=(plot.Axis(), plot.Axis(size=60)),
        )

    def _add_map(self, scene: Any) -> None:
        scene.set_up_direction("+y")
        x, y, z = self._about.room_size
        scene.add_grid(
            "/floor", width=x, height=z, plane="xz", position=(0, -y / 2, 0), cell_size=0.5, section_size=1.0
        )
        if self._about.person:
            scene.add_line_segments("/room", _edges(self._about.room_size), (190, 195, 200), thickness_units="screen",
                                    thickness=1.0)  # fmt: skip
        ball = _ball()
        self._ellipsoids = scene.add_batched_meshes_simple(
            "/features", *ball, **_ellipsoids(None), opacity=0.55, lod="off", cast_shadow=False, receive_shadow=False
        )
        if not self._about.replay:
            self._ellipsoids.on_click(self._mark_clicked)
        width, height = self._about.image_size
        fov = 2.0 * np.arctan(0.5 * height / self._about.focal)
        self._frustum = scene.add_camera_frustum(
            "/camera", fov, width / height, scale=0.16, color=rgb(VERMILLION), thickness=0.006, cast_shadow=False
        )
        self._place_ball = scene.add_mesh_simple("/place", *ball, color=rgb(VERMILLION), opacity=0.35)
        self._arrow = scene.add_arrows(
            "/advice", _AHEAD, rgb(BLUE), shaft_radius=0.015, head_radius=0.04, head_length=0.09, visible=False
        )
        self._way = scene.add_line_segments("/way", _AHEAD, rgb(VERMILLION), thickness_units="screen", thickness=2.0,
                                            visible=False)  # fmt: skip
        self._label = scene.add_label("/camera/command", "", position=(0.0, -0.16, 0.1))

    # Showing a state --------------------------------------------------------------------------------------------------

    def show(self, state: State) -> None:
        """Show a state; waits while the last one is younger than the least time between pictures."""
        time.sleep(max(0.0, self._shown + _OFTEN - time.monotonic()))
        self._shown = time.monotonic()
        first, self._state = self._state is None, state
        self._history.add(state)
        with self._server.atomic():
            self._show_view(state)
            self._show_map(state)
            if first:
                self._show_start(state)
            due = self._paused or state.frame < 2 or self._shown - self._drawn > _SELDOM
            if due or state.command != self._command_shown:
                self._show_reasons(state)
        self._server.flush()

    def notify(self, message: str) -> None:
        """Show a message to every visitor."""
        for client in self._server.get_clients().values():
            client.add_notification("Live", message, auto_close_seconds=6.0)

    def _show_view(self, state: State) -> None:
        picture = drawing.view(state)
        self._view.image = picture
        self._frustum.image = picture[:: drawing.SCALE, :: drawing.SCALE]
        self._set(self._standing, drawing.standing(state, self._paused))

    def _show_map(self, state: State) -> None:
        if not (np.isfinite(state.camera).all() and np.isfinite(state.camera_covariance).all()):
            return
        p, q = state.camera[:3], state.camera[3:7]
        self._frustum.position, self._frustum.wxyz = p, quaternion_product(q, _HALF_TURN)
        sizes, turns = _axes(state.camera_covariance[None])
        self._place_ball.position, self._place_ball.wxyz, self._place_ball.scale = p, turns[0], tuple(sizes[0])
        for name, values in _ellipsoids(state).items():
            setattr(self._ellipsoids, name, values)
        way = rotation_matrix(q) @ np.array(_WAYS[state.motion], float)
        self._arrow.visible = state.motion != Motion.STAY
        if self._arrow.visible:
            self._arrow.points = np.array([[p, p + 0.3 * way]], np.float32)

    def _show_start(self, state: State) -> None:
        """Show the target, from behind the camera."""
        scene, p, R_WC = self._server.scene, state.camera[:3], rotation_matrix(state.camera[3:7])
        if len(state.fiducials):
            scene.add_point_cloud("/target", state.fiducials.astype(np.float32), rgb(ORANGE), point_size=0.035,
                                  point_shape="circle")  # fmt: skip
        self._eye, self._aim = p + R_WC @ np.array((0.8, 1.2, -2.8)), p + R_WC @ np.array((0.0, -0.1, 0.9))
        self._server.initial_camera.position, self._server.initial_camera.look_at = self._eye, self._aim
        for client in self._server.get_clients().values():
            self._place_viewer(client)

    def _place_viewer(self, client: Any) -> None:
        """Look from behind the start; on a phone from farther away, with the map above the sheet."""
        if self._eye is not None and self._aim is not None:
            back, down = (1.5, 1.4) if client.camera.aspect < 1.0 else (1.0, 0.0)
            client.camera.position = self._aim + back * (self._eye - self._aim)
            client.camera.look_at = self._aim - (0.0, down, 0.0)

    def _show_reasons(self, state: State) -> None:
        """Show the command, bars, curves and the way, which change slowly."""
        self._drawn, self._command_shown = self._shown, state.command
        self._set(self._command, drawing.command(state))
        motion = state.motion
        self._server.gui.set_panel_label(f"{SIGNS[motion]}  {NAMES[motion]}")
        self._label.text = NAMES[motion]
        best = int(motion) if np.isfinite(state.scores).all() else None
        self._set(self._why, drawing.bars("Why: what each motion would teach", state.scores, best, 1, "bits"))
        self._set(self._counts, drawing.counts(state))
        self._set(self._marked, drawing.mark(state))
        self._set(self._commands, drawing.bars("Advice so far", state.advised, best, 0, "times"))
        self._curves.data = data = drawing.columns(self._history.curves)
        if data[0].size:  # NaN, where there is no dot, would leave uPlot without a range
            scale, t, y = viser().uplot.Scale, data[0], np.array(data[1:4])
            x_range, y_range = (float(t[0]), float(t[-1]) + 0.1), (float(y.min()) - 5.0, float(y.max()) + 5.0)
            self._curves.scales = {"x": scale(time=False, range=x_range), "y": scale(range=y_range)}
        way = self._history.way
        if len(way) > 1:
            self._way.points, self._way.visible = np.stack((way[:-1], way[1:]), axis=1).astype(np.float32), True
        if self._about.person and state.follows is not None and self._follow.value != state.follows:
            self._follow.value = state.follows

    def _set(self, element: Any, content: str) -> None:
        """Set the content of an element, if it differs."""
        padded = f'<div style="padding:0 12px">{content}</div>'
        if element.content != padded:
            element.content = padded

    # Buttons ----------------------------------------------------------------------------------------------------------

    def _step(self) -> None:
        self._set_paused(True)
        self._request(STEP, True)

    def _set_paused(self, paused: bool) -> None:
        self._paused = paused
        self._pause.label = "Go on" if paused else "Pause"
        self._pause.icon = viser().Icon.PLAYER_PLAY if paused else viser().Icon.PLAYER_PAUSE
        self._request(PAUSE, paused)
        if self._state is not None:
            self._set(self._standing, drawing.standing(self._state, paused))

    def _mark_middle(self) -> None:
        if self._state is not None:
            self._request(MARK, drawing.middle_feature(self._state))

    def _mark_clicked(self, event: Any) -> None:
        """Mark the feature nearest to the ray of the click; if it is marked, unmark it."""
        state = self._state
        if state is None or not len(state.ids):
            return
        sights = state.points - np.array(event.ray_origin)
        along = sights @ np.array(event.ray_direction)
        away = np.linalg.norm(sights - along[:, None] * np.array(event.ray_direction), axis=1) / np.maximum(along, 0.05)
        id = int(state.ids[away.argmin()])
        self._request(MARK, 0 if id == state.marked else id)

    def _save(self, event: Any) -> None:
        """Send the map to the browser, and ask the tracker to save the recording."""
        state = self._state
        if state is not None and event.client is not None:
            table = map_table(state.ids, state.points, state.stds)
            event.client.send_file_download("map.csv", table.encode(), save_immediately=True)
        self._request(SAVE, True)


def _quiet_server(host: str, port: int, guard: Guard) -> Any:
    """A server that prints nothing, opens no tunnel, and answers only requests that ``guard`` admits."""
    made = viser()

    class Private(made.ViserServer):  # type: ignore[name-defined, misc]
        """Any client may ask for a public address; it gets none."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # of malformed requests
    stdout, sys.stdout = sys.stdout, open("/dev/null", "w")  # noqa: SIM115
    try:
        with guarding(guard):
            return Private(host, port, verbose=False)
    finally:
        sys.stdout = stdout


def _ellipsoids(state: State | None) -> dict[str, np.ndarray]:
    """Positions, orientations, scales and colours of `_CAPACITY` ellipsoids: those of features, the others hidden."""
    places, scales = np.tile(_NOWHERE, (_CAPACITY, 1)), np.full((_CAPACITY, 3), 1e-3)
    turns, colours = np.tile((1.0, 0.0, 0.0, 0.0), (_CAPACITY, 1)), np.tile(rgb(SKY), (_CAPACITY, 1)).astype(np.uint8)
    finite = state is not None and np.isfinite(state.points).all(1) & np.isfinite(state.covariances).all((1, 2))
    kept = np.flatnonzero(finite)[-_CAPACITY:]
    if state is not None and (n := len(kept)):
        places[:n] = state.points[kept]
        scales[:n], turns[:n] = _axes(state.covariances[kept])
        colours[:n][state.mapped[kept]] = rgb(BLUE)
        colours[:n][state.ids[kept] == state.marked] = rgb(VERMILLION)
    values = (places.astype(np.float32), turns.astype(np.float32), scales.astype(np.float32), colours)
    return dict(zip(("batched_positions", "batched_wxyzs", "batched_scales", "batched_colors"), values))


def _axes(covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-lengths (n, 3) [m], bounded, and orientations (n, 4), scalar first, of ellipsoids of ``covariances``."""
    from scipy.spatial.transform import Rotation

    squares, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, not a reflection
    sizes = np.clip(SIGMAS * np.sqrt(np.maximum(squares, 0.0)), 0.02, _LONGEST)
    return sizes, Rotation.from_matrix(axes).as_quat(scalar_first=True)


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and faces (f, 3) of a unit ball."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    return ball.vertices.astype(np.float32), ball.faces.astype(np.uint32)


def _edges(size: tuple[float, float, float]) -> np.ndarray:
    """The twelve edges (12, 2, 3) of a room about the origin."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * np.array(size) / 2
    pairs = [(a, b) for a in range(8) for b in range(a) if np.count_nonzero(corners[a] != corners[b]) == 1]
    return corners[np.array(pairs)].astype(np.float32)


def serve(connection: Connection, about: About, host: str, port: int) -> None:
    """The page's process: sends its address or an error, then shows messages and the newest state until the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the tracker handles Ctrl-C
    lock = threading.Lock()

    def request(name: str, value: Any) -> None:
        with lock:
            connection.send((name, value))

    try:
        page = Page(about, host, port, request)
    except (ImportError, OSError) as error:
        connection.send(error)
        return
    connection.send(page.address)
    try:
        while True:
            state = None
            while state is None or connection.poll(0):
                received = connection.recv()
                if isinstance(received, State):
                    state = received
                else:
                    page.notify(received)
            page.show(state)
    except (EOFError, OSError):
        page.close()
