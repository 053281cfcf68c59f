"""The page: the map in three dimensions, the camera's view, the command and its reasons.

viser (the extra `live`) serves the same page to every browser that has `access`. It refuses requests for a public
tunnel, and it writes no file of this machine. A thread draws the newest state, so that tracking never waits for it.
"""

import io
import logging
import math
import threading
import time
from collections import deque
from contextlib import redirect_stdout
from html import escape
from itertools import combinations, product
from queue import SimpleQueue
from typing import Any, Literal

import numpy as np

from activeslam_gym.geometry import quaternion_product, rotation_matrix
from activeslam_gym.live import drawing
from activeslam_gym.live.access import Access, check_address
from activeslam_gym.live.device import Device
from activeslam_gym.live.drawing import CURVES, SIGNS
from activeslam_gym.live.session import Source
from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import MOTION_AXIS, MOTION_SIGN, Motion
from activeslam_gym.vision.film import BLUE, ORANGE, SKY, VERMILLION, rgb, view
from activeslam_gym.vision.report import map_table

Request = Literal["pause", "restart", "follow", "save"]
"""Requests of the page, each with a value: whether to pause, True, whether the simulated person follows, and who asks
to save."""
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
_MOST = 1200
"""Moments in the curves."""
_FIRST = 3
"""First images, whose corrections of the start are no motion."""
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
    """Serves the page of a ``source`` at ``host`` and ``port``, which asks for the camera if that is a `Device`.

    Raises:
        ModuleNotFoundError: viser is not installed.
        OSError: no page can be served there, or the installed viser cannot be guarded.
    """

    def __init__(self, source: Source, host: str, port: int) -> None:
        check_address(host, port)
        self._source, device = source, source if isinstance(source, Device) else None
        self._films, self.access = device is not None, Access(host, device)
        self.requests: SimpleQueue[tuple[Request, Any]] = SimpleQueue()
        """What the visitors ask for."""
        self._history = list[tuple[float, ...]]()
        """Of each image: time, log2 |P| of camera, map and total, landmarks, and the camera's position."""
        self._paused, self._latest = False, deque[State](maxlen=1)
        self._state: State | None = None
        self._shown, self._drawn, self._opened = 0.0, 0.0, time.monotonic()
        self._server = _quiet_server(host, port, self.access)
        self.address = self.access.address(self._server.get_port())
        """Address of the page, with its token."""
        self._add_guide(self._server.gui)
        self._add_left_panels(self._server.gui)
        self._add_map(self._server.scene)
        self._server.on_client_connect(self._place_viewer)
        self._new, self._closed = threading.Event(), False
        self._drawer = threading.Thread(target=self._draw_all, daemon=True)
        self._drawer.start()

    def show(self, state: State) -> None:
        """Show a state; returns at once. It replaces a state that is not drawn yet."""
        self._latest.append(state)
        self._new.set()

    def notify(self, client: Any, message: str) -> None:
        """Show a message to a visitor, a `client` of viser."""
        client.add_notification("Live", message, auto_close_seconds=6.0)

    def close(self) -> None:
        """Stop the server."""
        self._closed = True
        self._new.set()
        self._drawer.join()
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _draw_all(self) -> None:
        """In a thread of its own: draw the newest state, until the end."""
        while not self._closed:
            if not self._new.wait(max(_PATIENCE, 2.0 * self._source.scenario.frame_time)):
                self._wait()
            self._new.clear()
            if self._latest and not self._closed:
                self.draw(self._latest.popleft())

    # Its elements -----------------------------------------------------------------------------------------------------

    def _add_guide(self, gui: Any) -> None:
        """Add the command, the view and the reasons at the right."""
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(BLUE), control_width="large")
        gui.set_panel_label("Where to move")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        gui.add_html(_ON_A_PHONE)
        self._command = gui.add_html(drawing.part("font-size:20px", f"{escape(self._source.name)} …"))
        self._standing = gui.add_html("")
        self._wait()
        scenario = self._source.scenario
        width, height = scenario.image_width, scenario.image_height
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
        ask = self.requests.put
        self._pause = gui.add_button("Pause", icon="player-pause")
        self._pause.on_click(lambda _: self._set_paused(not self._paused))
        gui.add_button("Restart", icon="refresh").on_click(lambda _: ask(("restart", True)))
        self._follow = gui.add_checkbox("Follow the advice", True, visible=self._source.person is not None)
        self._follow.on_update(lambda event: event.client and ask(("follow", bool(self._follow.value))))
        save = gui.add_button("Save", icon="device-floppy", hint="The map, to this browser and to the recording")
        save.on_click(self._save)

    def _add_map(self, scene: Any) -> None:
        import trimesh

        scene.set_up_direction("+y")
        x, y, z = room = self._source.scenario.room_size
        scene.add_grid(
            "/floor", width=x, height=z, plane="xz", position=(0, -y / 2, 0), cell_size=0.5, section_size=1.0
        )
        thin, red = {"thickness_units": "screen", "thickness": 1.0}, rgb(VERMILLION)
        if self._source.person is not None:
            scene.add_line_segments("/floor/room", _edges(room) + (0, y / 2, 0), (190, 195, 200), **thin)
        ball, flat = trimesh.creation.icosphere(subdivisions=2), {"cast_shadow": False, "receive_shadow": False}
        self._ellipsoids = scene.add_batched_meshes_simple(
            "/features", ball.vertices, ball.faces, **_ellipsoids(None), opacity=0.55, lod="off", **flat
        )
        self._frustum = scene.add_camera_frustum(
            "/camera", *self._lens, scale=0.16, color=red, thickness=0.006, cast_shadow=False
        )
        self._label = scene.add_label("/camera/command", "", position=(0.0, -0.16, 0.1))
        self._place_ball = scene.add_icosphere("/place", color=red, subdivisions=2, opacity=0.35)
        size = {"shaft_radius": 0.015, "head_radius": 0.04, "head_length": 0.09}
        self._arrow = scene.add_arrows("/advice", _AHEAD, rgb(BLUE), **size, visible=False)
        self._way = scene.add_line_segments("/way", _AHEAD, red, **{**thin, "thickness": 2.0}, visible=False)

    # Showing a state --------------------------------------------------------------------------------------------------

    @property
    def _lens(self) -> tuple[float, float]:
        """Field of view, up and down, and width over height; those of a device change as it is calibrated."""
        lens = self._source.scenario
        return 2.0 * math.atan(0.5 * lens.image_height / lens.focal_px), lens.image_width / lens.image_height

    def draw(self, state: State) -> None:
        """Draw a state; waits while the last one is younger than the least time between pictures."""
        time.sleep(max(0.0, self._shown + _OFTEN - time.monotonic()))
        self._shown = time.monotonic()
        before, self._state = self._state.frame if self._state else 0, state
        self._remember(state)
        with self._server.atomic():
            self._view.image = picture = view(state)
            self._frustum.image = picture[:: (step := max(1, picture.shape[1] // _FRUSTUM)), ::step]
            self._standing.content = drawing.standing(state, self._paused)
            if np.isfinite(state.camera).all() and np.isfinite(state.camera_covariance).all():
                self._show_map(state)
            if 0 < state.frame and not 0 < before <= state.frame:  # the first one since a start
                self._show_start(state)
            due = self._paused or state.frame < 2 or self._shown - self._drawn > _SELDOM
            if due or self._label.text != drawing.advice(state).words:
                self._show_reasons(state)
        self._server.flush()

    def _wait(self) -> None:
        """No state comes: tell for how long, and no command any more."""
        state, seconds = self._state, time.monotonic() - (self._shown or self._opened)
        if state is not None and (self._paused or state.standing == Standing.OVER or seconds < _PATIENCE):
            return
        compiles = state is None or (state.frame < 3 and state.standing != Standing.WAITING)
        self._standing.content = drawing.waiting(seconds, self._films, compiles)
        if state is not None:
            self._show_command(drawing.advice(state, images=False))

    def _remember(self, state: State) -> None:
        """Add a state to the curves; one of another start starts new ones."""
        if self._history and (state.frame == 0 or state.time < self._history[-1][0]):
            self._history.clear()
        if np.isfinite(state.log2_dets).all():
            position = state.camera[:3] if state.frame > _FIRST else np.full(3, np.nan)
            self._history.append((state.time, *state.log2_dets, state.landmarks, *position))

    def _show_map(self, state: State) -> None:
        p, q = state.camera[:3], state.camera[3:7]
        self._frustum.position, self._frustum.wxyz = p, quaternion_product(q, _HALF_TURN)
        self._frustum.fov, self._frustum.aspect = self._lens
        sizes, turns = _axes(state.camera_covariance[None])
        self._place_ball.position, self._place_ball.wxyz, self._place_ball.scale = p, turns[0], tuple(sizes[0])
        for name, values in _ellipsoids(state).items():
            setattr(self._ellipsoids, name, values)
        motion = drawing.advice(state).motion
        self._arrow.visible = motion != Motion.STAY
        if self._arrow.visible:
            way = rotation_matrix(q)[:, MOTION_AXIS[motion]] * MOTION_SIGN[motion]
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
        if self._state is not None and self._state.frame > 0:
            eye, aim = self._server.initial_camera.position, self._server.initial_camera.look_at
            back, down = (1.5, 1.4) if client.camera.aspect < 1.0 else (1.0, 0.0)
            client.camera.position, client.camera.look_at = aim + back * (eye - aim), aim - (0.0, down, 0.0)

    def _show_reasons(self, state: State) -> None:
        """Show the command, bars, curves and the way, which change slowly."""
        self._drawn = self._shown
        self._show_command(drawing.advice(state))
        self._why.content = drawing.reasons(state)
        self._counts.content = drawing.counts(state)
        self._commands.content = drawing.bars("Advice so far", state.advised, state.command, 0, "times")
        self._show_history()
        if state.follows is not None and self._follow.value != state.follows:
            self._follow.value = state.follows

    def _show_command(self, advice: drawing.Advice) -> None:
        self._label.text = advice.words
        self._arrow.visible = self._arrow.visible and advice.motion != Motion.STAY
        self._server.gui.set_panel_label(f"{SIGNS[advice.motion]}  {advice.words}")
        self._command.content = drawing.command(advice)

    def _show_history(self) -> None:
        """Show the entropies, and the way of the camera, by `_MOST` moments at the most."""
        if not self._history:
            self._curves.data, self._way.visible = (np.zeros(0),) * 5, False
            return
        rows = np.array(self._history[:: len(self._history) // _MOST + 1])
        t, *curves, landmarks = rows[:, :5].T.copy()
        new = np.where(np.diff(landmarks, prepend=0.0) > 0.0, curves[-1], np.nan)
        self._curves.data = t, *curves, new
        # NaN, where there is no dot, would leave uPlot without a range
        ranges = {"x": (t[0], t[-1] + 0.1), "y": (np.min(curves) - 5.0, np.max(curves) + 5.0)}
        self._curves.scales = {one: {"time": False, "range": tuple(map(float, ranges[one]))} for one in ranges}
        way = rows[np.isfinite(rows[:, 5]), 5:]
        self._way.visible = len(way) > 1
        if self._way.visible:
            self._way.points = np.stack((way[:-1], way[1:]), axis=1)

    # Buttons ----------------------------------------------------------------------------------------------------------

    def _set_paused(self, paused: bool) -> None:
        self._paused, self._shown = paused, time.monotonic()
        self._pause.label, self._pause.icon = ("Go on", "player-play") if paused else ("Pause", "player-pause")
        self.requests.put(("pause", paused))
        if self._state is not None:
            self._standing.content = drawing.standing(self._state, paused)

    def _save(self, event: Any) -> None:
        """Send the map to the browser that asks, and ask the tracker to save the recording."""
        state, client = self._state, event.client
        if client is None:
            return
        if state is None or state.frame == 0:
            self.notify(client, "There is no map yet.")
            return
        table = map_table(state.ids, state.points, state.stds)
        client.send_file_download("map.csv", table.encode(), save_immediately=True)
        self.requests.put(("save", client))


def _quiet_server(host: str, port: int, access: Access) -> Any:
    """A server that prints nothing, opens no tunnel, and answers only those who have ``access``."""
    try:
        import viser
    except ModuleNotFoundError:
        raise ModuleNotFoundError("viser is needed to serve the page: install the extra `live`") from None

    class Private(viser.ViserServer):
        """Any client may ask for a public address; it gets none."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # of malformed requests
    with redirect_stdout(io.StringIO()), access.guarding():
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
