"""The page, in a process of its own: the map in three dimensions, the camera's view, the command and its reasons.

viser (the extra `live`) serves the same page to every browser, behind a `guard`. It refuses requests for a public
tunnel, and it writes no file of this machine.
"""

import io
import logging
import signal
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from html import escape
from itertools import combinations, product
from multiprocessing.connection import Connection
from ssl import SSLContext
from typing import Any

import numpy as np

from activeslam_gym.geometry import quaternion_product, rotation_matrix
from activeslam_gym.live import drawing
from activeslam_gym.live.drawing import CURVES, NAMES, SIGNS
from activeslam_gym.live.filming import Filming
from activeslam_gym.live.guard import Guard, guarding
from activeslam_gym.live.history import History
from activeslam_gym.live.state import About, Request, State
from activeslam_gym.motion import MOTION_AXIS, MOTION_SIGN, Motion
from activeslam_gym.vision.film import BLUE, ORANGE, SKY, VERMILLION, rgb, view
from activeslam_gym.vision.track_files import map_table

_SIGMAS = 2.0
"""Of the ellipsoids in the map."""
_CAPACITY = 64
"""Ellipsoids: more than there are features."""
_FRUSTUM = 320
"""Width of the picture in the camera's frustum [px]."""
_LONGEST = 0.6
"""Greatest half-length of an ellipsoid [m]; a new feature's depth is hardly known."""
_OFTEN, _SELDOM = 1.0 / 16.0, 0.5
"""Least time between two pictures, and between two drawings of curves and bars [s]."""
_PATIENCE = 1.0
"""Time without a state after which the page waits [s]."""
_AHEAD = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 0.3)]])
_HALF_TURN = np.array((0.0, 0.0, 0.0, 1.0))
"""From the filter's camera, x left and y up, to the page's, x right and y down."""
_ON_A_PHONE = """<style>@media (max-width: 576px) {
.mantine-Paper-root[style*="60%"], .mantine-Paper-root[style*="60%"] div[style*="20em"] { width: 100% !important; }
}</style>"""
"""The sheet below the map takes the whole width, of which viser's own leaves a third."""


class Page:
    """Serves the page at ``host`` and ``port``, which asks for a camera if there is a ``filming``; a button calls
    ``request(name, value)``, see `Request`.

    Raises:
        ModuleNotFoundError: viser is not installed.
        OSError: the installed viser cannot be guarded.
    """

    def __init__(
        self,
        about: About,
        host: str,
        port: int,
        request: Callable[[Request, Any], None],
        filming: Filming | None = None,
    ) -> None:
        self._about, self._request, self._films = about, request, filming is not None
        self._paused, self._history = False, History()
        self._state: State | None = None
        self._shown, self._drawn, self._opened = 0.0, 0.0, time.monotonic()
        guard, tls, self.fingerprint = Guard.of(host), None, ""
        """Of the page's certificate, if it is encrypted."""
        if self._films and guard.token:
            guard, tls, self.fingerprint = guard.encrypted()
        self._server = _quiet_server(host, port, guard, filming, tls)
        self.address = guard.address(host, self._server.get_port())
        """Address of the page, with its token."""
        self._add_guide(self._server.gui)
        self._add_left_panels(self._server.gui)
        self._add_map(self._server.scene)
        self._server.on_client_connect(self._place_viewer)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    # Its elements -----------------------------------------------------------------------------------------------------

    def _add_guide(self, gui: Any) -> None:
        """Add the command, the view and the reasons at the right."""
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(BLUE), control_width="large")
        gui.set_panel_label("Where to move")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        gui.add_html(_ON_A_PHONE)
        self._command = gui.add_html(drawing.part("font-size:20px", f"{escape(self._about.name)} …"))
        self._standing = gui.add_html("")
        self.wait()
        width, height = self._about.image_size
        self._view = gui.add_image(np.zeros((height, width, 3), np.uint8))
        gui.add_html(drawing.legend())
        self._why = gui.add_html("")

    def _add_left_panels(self, gui: Any) -> None:
        """Add figure 5 of the paper and the controls beside the map."""
        panel, controls = gui.add_panel(), gui.add_panel()
        with panel.add_tab("What is known"):
            self._counts = gui.add_html("")
            gui.add_html(drawing.title("Entropy, log₂ |P|", "the lower, the more is known"))
            self._curves = _add_curves(gui)
            self._commands = gui.add_html("")
        panel.dock_left()
        panel.set_width(330)
        with controls.add_tab("Controls"):
            self._add_buttons(gui)
        controls.dock_below(panel)

    def _add_buttons(self, gui: Any) -> None:
        about, request = self._about, self._request
        self._pause = gui.add_button("Pause", icon="player-pause")
        self._pause.on_click(lambda _: self._set_paused(not self._paused))
        gui.add_button("Restart", icon="refresh").on_click(lambda _: request("restart", True))
        self._follow = gui.add_checkbox("Follow the advice", True, visible=about.person)
        self._follow.on_update(lambda event: event.client and request("follow", bool(self._follow.value)))
        save = gui.add_button("Save", icon="device-floppy", hint="The map, to this browser and to the recording")
        save.on_click(self._save)

    def _add_map(self, scene: Any) -> None:
        import trimesh

        scene.set_up_direction("+y")
        x, y, z = self._about.room_size
        scene.add_grid(
            "/floor", width=x, height=z, plane="xz", position=(0, -y / 2, 0), cell_size=0.5, section_size=1.0
        )
        thin, red = {"thickness_units": "screen", "thickness": 1.0}, rgb(VERMILLION)
        if self._about.person:
            scene.add_line_segments(
                "/floor/room", _edges(self._about.room_size) + (0, y / 2, 0), (190, 195, 200), **thin
            )
        ball, flat = trimesh.creation.icosphere(subdivisions=2), {"cast_shadow": False, "receive_shadow": False}
        self._ellipsoids = scene.add_batched_meshes_simple(
            "/features", ball.vertices, ball.faces, **_ellipsoids(None), opacity=0.55, lod="off", **flat
        )
        width, height = self._about.image_size
        fov = 2.0 * np.arctan(0.5 * height / self._about.focal)
        self._frustum = scene.add_camera_frustum(
            "/camera", fov, width / height, scale=0.16, color=red, thickness=0.006, cast_shadow=False
        )
        self._label = scene.add_label("/camera/command", "", position=(0.0, -0.16, 0.1))
        self._place_ball = scene.add_icosphere("/place", color=red, subdivisions=2, opacity=0.35)
        size = {"shaft_radius": 0.015, "head_radius": 0.04, "head_length": 0.09}
        self._arrow = scene.add_arrows("/advice", _AHEAD, rgb(BLUE), **size, visible=False)
        self._way = scene.add_line_segments("/way", _AHEAD, red, **{**thin, "thickness": 2.0}, visible=False)

    # Showing a state --------------------------------------------------------------------------------------------------

    def show(self, state: State) -> None:
        """Show a state; waits while the last one is younger than the least time between pictures."""
        time.sleep(max(0.0, self._shown + _OFTEN - time.monotonic()))
        self._shown = time.monotonic()
        first, self._state = self._state is None, state
        self._history.add(state)
        with self._server.atomic():
            self._view.image = picture = view(state.moment)
            self._frustum.image = picture[:: (step := max(1, picture.shape[1] // _FRUSTUM)), ::step]
            self._standing.content = drawing.standing(state, self._paused)
            if np.isfinite(state.camera).all() and np.isfinite(state.camera_covariance).all():
                self._show_map(state)
            if first:
                self._show_start(state)
            due = self._paused or state.frame < 2 or self._shown - self._drawn > _SELDOM
            if due or self._label.text != NAMES[state.command]:
                self._show_reasons(state)
        self._server.flush()

    def wait(self) -> None:
        """No state has come for a second: before the third one, while kernels are compiled, tell for how long."""
        if self._state is None or (self._state.frame < 3 and not self._paused):
            seconds = time.monotonic() - (self._shown or self._opened)
            self._standing.content = drawing.waiting(seconds, self._films and self._state is None)

    def look_through(self, about: About) -> None:
        """Draw the camera with another lens."""
        width, height = about.image_size
        self._frustum.fov, self._frustum.aspect = 2.0 * np.arctan(0.5 * height / about.focal), width / height

    def notify(self, message: str) -> None:
        """Show a message to every visitor."""
        for client in self._server.get_clients().values():
            client.add_notification("Live", message, auto_close_seconds=6.0)

    def _show_map(self, state: State) -> None:
        p, q = state.camera[:3], state.camera[3:7]
        self._frustum.position, self._frustum.wxyz = p, quaternion_product(q, _HALF_TURN)
        sizes, turns = _axes(state.camera_covariance[None])
        self._place_ball.position, self._place_ball.wxyz, self._place_ball.scale = p, turns[0], tuple(sizes[0])
        for name, values in _ellipsoids(state).items():
            setattr(self._ellipsoids, name, values)
        self._arrow.visible = state.command != Motion.STAY
        if self._arrow.visible:
            way = rotation_matrix(q)[:, MOTION_AXIS[state.command]] * MOTION_SIGN[state.command]
            self._arrow.points = np.array([[p, p + 0.3 * way]])

    def _show_start(self, state: State) -> None:
        """Show the target, from behind the camera."""
        p, R_WC = state.camera[:3], rotation_matrix(state.camera[3:7])
        if len(state.fiducials):
            look = {"point_size": 0.035, "point_shape": "circle"}
            self._server.scene.add_point_cloud("/target", state.fiducials, rgb(ORANGE), **look)
        self._server.initial_camera.position = p + R_WC @ np.array((0.8, 1.2, -2.8))
        self._server.initial_camera.look_at = p + R_WC @ np.array((0.0, -0.1, 0.9))
        for client in self._server.get_clients().values():
            self._place_viewer(client)

    def _place_viewer(self, client: Any) -> None:
        """Look from behind the start; on a phone from farther away, with the map above the sheet."""
        if self._state is not None:
            eye, aim = self._server.initial_camera.position, self._server.initial_camera.look_at
            back, down = (1.5, 1.4) if client.camera.aspect < 1.0 else (1.0, 0.0)
            client.camera.position, client.camera.look_at = aim + back * (eye - aim), aim - (0.0, down, 0.0)

    def _show_reasons(self, state: State) -> None:
        """Show the command, bars, curves and the way, which change slowly."""
        self._drawn, name = self._shown, NAMES[state.command]
        self._label.text = name
        self._server.gui.set_panel_label(f"{SIGNS[state.command]}  {name}")
        self._command.content, self._why.content = drawing.command(state), drawing.reasons(state)
        self._counts.content = drawing.counts(state)
        self._commands.content = drawing.bars("Advice so far", state.advised, state.command, 0, "times")
        self._curves.data = t, *curves, _ = self._history.curves
        if t.size:  # NaN, where there is no dot, would leave uPlot without a range
            ranges = {"x": (t[0], t[-1] + 0.1), "y": (np.min(curves) - 5.0, np.max(curves) + 5.0)}
            self._curves.scales = {one: {"time": False, "range": tuple(map(float, ranges[one]))} for one in ranges}
        way = self._history.way
        if len(way) > 1:
            self._way.points, self._way.visible = np.stack((way[:-1], way[1:]), axis=1), True
        if state.follows is not None and self._follow.value != state.follows:
            self._follow.value = state.follows

    # Buttons ----------------------------------------------------------------------------------------------------------

    def _set_paused(self, paused: bool) -> None:
        self._paused = paused
        self._pause.label, self._pause.icon = ("Go on", "player-play") if paused else ("Pause", "player-pause")
        self._request("pause", paused)
        if self._state is not None:
            self._standing.content = drawing.standing(self._state, paused)

    def _save(self, event: Any) -> None:
        """Send the map to the browser, and ask the tracker to save the recording."""
        state = self._state
        if state is not None and event.client is not None:
            table = map_table(state.ids, state.points, state.stds)
            event.client.send_file_download("map.csv", table.encode(), save_immediately=True)
        self._request("save", True)


def _quiet_server(host: str, port: int, guard: Guard, filming: Filming | None, tls: SSLContext | None) -> Any:
    """A server that prints nothing, opens no tunnel, and answers only requests that ``guard`` admits."""
    try:
        import viser
    except ModuleNotFoundError:
        raise ModuleNotFoundError("viser is needed to serve the page: install the extra `live`") from None

    class Private(viser.ViserServer):
        """Any client may ask for a public address; it gets none."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # of malformed requests
    with redirect_stdout(io.StringIO()), guarding(guard, filming, tls):
        return Private(host, port, verbose=False)


def _add_curves(gui: Any) -> Any:
    """Add the entropies over time: lines, and a dot on the total where a landmark is new."""
    lines = ({"label": name, "stroke": colour, "width": 1.8} for name, colour in CURVES.items())
    dots = {"label": "new landmark", "stroke": ORANGE, "width": 0.0, "points": {"show": True, "fill": ORANGE}}
    series, scales = ({"label": "s"}, *lines, dots), {"x": {"time": False}}
    return gui.add_uplot((np.zeros(0),) * 5, series, scales=scales, aspect=1.7, axes=({}, {"size": 60}))


def _ellipsoids(state: State | None) -> dict[str, np.ndarray]:
    """Positions, orientations, scales and colours of `_CAPACITY` ellipsoids: those of features, the others far away."""
    places, scales, turns = np.full((_CAPACITY, 3), -1e3), np.full((_CAPACITY, 3), 1e-3), np.eye(1, 4)
    turns, colours = turns.repeat(_CAPACITY, axis=0), np.full((_CAPACITY, 3), rgb(SKY), np.uint8)
    if state is not None:
        finite = np.isfinite(state.points).all(1) & np.isfinite(state.covariances).all((1, 2))
        if n := len(kept := np.flatnonzero(finite)[-_CAPACITY:]):
            places[:n] = state.points[kept]
            scales[:n], turns[:n] = _axes(state.covariances[kept])
            colours[:n][state.mapped[kept]] = rgb(BLUE)
    return {"batched_positions": places, "batched_wxyzs": turns, "batched_scales": scales, "batched_colors": colours}


def _axes(covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-lengths (n, 3) [m], bounded, and orientations (n, 4), scalar first, of ellipsoids of ``covariances``."""
    from scipy.spatial.transform import Rotation

    squares, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, not a reflection
    sizes = np.clip(_SIGMAS * np.sqrt(np.maximum(squares, 0.0)), 0.02, _LONGEST)
    return sizes, Rotation.from_matrix(axes).as_quat(scalar_first=True)


def _edges(size: tuple[float, float, float]) -> np.ndarray:
    """The twelve edges (12, 2, 3) of a room about the origin."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * size
    return np.array([pair for pair in combinations(corners, 2) if np.count_nonzero(pair[0] != pair[1]) == 1])


def serve(connection: Connection, about: About, host: str, port: int, filming: Filming | None) -> None:
    """The page's process: sends its address or an error, then shows messages and the newest state until the end."""
    for name in {"SIGINT", "SIGHUP"} & set(dir(signal)):  # the tracker handles Ctrl-C, and a terminal that is closed
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    lock = threading.Lock()

    def request(name: Request, value: Any) -> None:
        with lock:
            connection.send((name, value))

    try:
        page = Page(about, host, port, request, filming)
    except (ImportError, OSError) as error:
        connection.send(error)
        return
    connection.send((page.address, page.fingerprint))
    try:
        while True:
            state = None
            while state is None or connection.poll(0):
                if not connection.poll(_PATIENCE):
                    page.wait()
                    continue
                received = connection.recv()
                if isinstance(received, State):
                    state = received
                elif isinstance(received, About):
                    page.look_through(received)
                else:
                    page.notify(received)
            page.show(state)
    except (EOFError, OSError):
        page.close()
