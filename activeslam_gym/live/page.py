"""The page, in a process of its own: the map in three dimensions, the camera's view, the command, and why.

It is served by viser (the extra `live`), to every browser the same, behind a `guard`. A page can be asked for a public
tunnel to it: that is refused. Nothing on it writes a file of this machine, but for the recording's folder, which the
tracker does.
"""

import logging
import sys
import time
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np

from activeslam_gym.geometry import quaternion_product, rotation_matrix
from activeslam_gym.live import drawing
from activeslam_gym.live.drawing import BLUE, NAMES, ORANGE, SIGNS, SKY, VERMILLION, rgb
from activeslam_gym.live.guard import Guard, guarding
from activeslam_gym.live.history import History
from activeslam_gym.live.link import FOLLOW, MARK, PAUSE, RESTART, SAVE, STEP, About
from activeslam_gym.live.state import State
from activeslam_gym.motion import Motion

SIGMAS = 2.0
"""Of the ellipsoids in the map."""
_ROOM_FOR = 64
"""Ellipsoids: more than there are features."""
_LONGEST = 0.6
"""An ellipsoid is drawn no longer than that to each side [m]: a new feature's depth is anything."""
_NOWHERE = (0.0, -1e3, 0.0)
_OFTEN, _SELDOM = 1.0 / 16.0, 0.5
"""Least time between two pictures, and between two drawings of curves and bars [s]."""
_AHEAD = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 0.3)]], np.float32)
_HALF_TURN = np.array((0.0, 0.0, 0.0, 1.0))
"""From the filter's camera, x left and y up, to the page's, x right and y down."""
_WAYS = {Motion.FORWARD: (0, 0, 1), Motion.BACKWARDS: (0, 0, -1), Motion.RIGHT: (-1, 0, 0), Motion.LEFT: (1, 0, 0),
         Motion.UP: (0, 1, 0), Motion.DOWN: (0, -1, 0), Motion.STAY: (0, 0, 0)}  # fmt: skip
"""Of the motions, in the filter's camera axes."""


_ON_A_PHONE = """<style>@media (max-width: 576px) {
.mantine-Paper-root[style*="60%"], .mantine-Paper-root[style*="60%"] div[style*="20em"] { width: 100% !important; }
}</style>"""
"""The sheet of words takes the whole width, of which viser's own leaves a third."""


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
    """Serves the page at ``host`` and ``port``; ``wish(name, value)`` is called where a button is pressed.

    Raises:
        ModuleNotFoundError: viser is not installed.
        OSError: what is installed cannot be guarded.
    """

    def __init__(self, about: About, host: str, port: int, wish: Callable[[str, Any], None]) -> None:
        self._about, self._wish = about, wish
        self._paused, self._history = False, History()
        self._state: State | None = None
        self._shown, self._drawn = 0.0, 0.0
        self._told: int | None = None
        guard = Guard.of(host)
        self._server = _quiet_server(host, port, guard)
        self.address = guard.address(host, self._server.get_port())
        """Where the page is, with its token."""
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(BLUE), control_width="large")
        gui.set_panel_label("Where to move")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        self._add_guide(gui)
        self._add_knowledge(gui)
        self._add_map(self._server.scene)
        self._eye: np.ndarray | None = None
        self._aim: np.ndarray | None = None
        self._server.on_client_connect(self._place_viewer)

    def close(self) -> None:
        """Serve no more."""
        self._server.stop()

    # What stands on it ------------------------------------------------------------------------------------------------

    def _add_guide(self, gui: Any) -> None:
        """Command, view and reasons."""
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
        self._pause.on_click(lambda _: self._toggle())
        step = gui.add_button("Single step", icon=icons.PLAYER_SKIP_FORWARD)
        step.on_click(lambda _: self._step())
        restart = gui.add_button("Restart", icon=icons.REFRESH)
        restart.on_click(lambda _: self._wish(RESTART, True))
        if self._about.person:
            follow = gui.add_checkbox("Follow the advice", True)
            follow.on_update(lambda event: self._wish(FOLLOW, follow.value) if event.client is not None else None)
            self._follow = follow
        if not self._about.replay:
            mark = gui.add_button("Mark what is in the middle", icon=icons.CROSSHAIR)
            mark.on_click(lambda _: self._mark_middle())
        self._marked = gui.add_html("")
        save = gui.add_button("Save", icon=icons.DEVICE_FLOPPY, hint="The map, to this browser and to the recording")
        save.on_click(self._save)

    def _add_knowledge(self, gui: Any) -> None:
        """Figure 5 of the paper, beside the map."""
        panel = gui.add_panel()
        with panel.add_tab("What is known"):
            self._counts = gui.add_html("")
            self._curves = gui.add_html("")
            self._commands = gui.add_html("")
        panel.dock_left()
        panel.set_width(330)
        controls = gui.add_panel()
        with controls.add_tab("Controls"):
            self._add_buttons(gui)
        controls.dock_below(panel)

    def _add_map(self, scene: Any) -> None:
        scene.set_up_direction("+y")
        x, y, z = self._about.room_size
        scene.add_grid(
            "/floor", width=x, height=z, plane="xz", position=(0, -y / 2, 0), cell_size=0.5, section_size=1.0
        )
        if self._about.room_is_known:
            scene.add_line_segments("/room", _edges(self._about.room_size), (190, 195, 200), thickness_units="screen",
                                    thickness=1.0)  # fmt: skip
        ball = _ball()
        self._ellipsoids = scene.add_batched_meshes_simple(
            "/features", *ball, batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (_ROOM_FOR, 1)),
            batched_positions=np.tile(_NOWHERE, (_ROOM_FOR, 1)), batched_scales=np.full((_ROOM_FOR, 3), 1e-3),
            batched_colors=np.tile(rgb(SKY), (_ROOM_FOR, 1)).astype(np.uint8), opacity=0.55, lod="off",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
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

    # What moves -------------------------------------------------------------------------------------------------------

    def show(self, state: State) -> None:
        """Show a state; waits a little where it comes too soon after the one before."""
        time.sleep(max(0.0, self._shown + _OFTEN - time.monotonic()))
        self._shown = time.monotonic()
        first, self._state = self._state is None, state
        self._history.add(state)
        with self._server.atomic():
            self._show_view(state)
            self._show_map(state)
            if first:
                self._show_what_stands(state)
            if state.command != self._told or self._shown - self._drawn > _SELDOM or state.frame < 2:
                self._show_reasons(state)
        self._server.flush()

    def tell(self, news: str) -> None:
        """Show a sentence to everybody."""
        for client in self._server.get_clients().values():
            client.add_notification("Live", news, auto_close_seconds=6.0)

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
        self._show_ellipsoids(state)
        way = rotation_matrix(q) @ np.array(_WAYS[state.motion], float)
        self._arrow.visible = state.motion != Motion.STAY
        if self._arrow.visible:
            self._arrow.points = np.array([[p, p + 0.3 * way]], np.float32)

    def _show_ellipsoids(self, state: State) -> None:
        finite = np.isfinite(state.points).all(1) & np.isfinite(state.covariances).all((1, 2))
        kept = np.flatnonzero(finite)[-_ROOM_FOR:]
        n = len(kept)
        places, scales = np.tile(_NOWHERE, (_ROOM_FOR, 1)), np.full((_ROOM_FOR, 3), 1e-3)
        turns = np.tile((1.0, 0.0, 0.0, 0.0), (_ROOM_FOR, 1))
        colours = np.tile(rgb(SKY), (_ROOM_FOR, 1)).astype(np.uint8)
        if n:
            places[:n] = state.points[kept]
            scales[:n], turns[:n] = _axes(state.covariances[kept])
            colours[:n][state.mapped[kept]] = rgb(BLUE)
            colours[:n][state.ids[kept] == state.marked] = rgb(VERMILLION)
        shapes = self._ellipsoids
        shapes.batched_positions, shapes.batched_wxyzs = places.astype(np.float32), turns.astype(np.float32)
        shapes.batched_scales, shapes.batched_colors = scales.astype(np.float32), colours

    def _show_what_stands(self, state: State) -> None:
        """The target, and the view from behind the camera."""
        scene, p, R_WC = self._server.scene, state.camera[:3], rotation_matrix(state.camera[3:7])
        if len(state.fiducials):
            scene.add_point_cloud("/target", state.fiducials.astype(np.float32), rgb(ORANGE), point_size=0.035,
                                  point_shape="circle")  # fmt: skip
        self._eye, self._aim = p + R_WC @ np.array((0.8, 1.2, -2.8)), p + R_WC @ np.array((0.0, -0.1, 0.9))
        self._server.initial_camera.position, self._server.initial_camera.look_at = self._eye, self._aim
        for client in self._server.get_clients().values():
            self._place_viewer(client)

    def _place_viewer(self, client: Any) -> None:
        """Behind the start; on a phone farther away, and so that the map is above the sheet of words."""
        if self._eye is not None and self._aim is not None:
            upright = client.camera.aspect < 1.0
            back, down = (1.5, 1.4) if upright else (1.0, 0.0)
            aim = self._aim - (0.0, down, 0.0)
            client.camera.position = self._aim + back * (self._eye - self._aim)
            client.camera.look_at = aim

    def _show_reasons(self, state: State) -> None:
        """What changes slowly: the command, bars, curves, the way."""
        self._drawn, self._told = self._shown, state.command
        self._set(self._command, drawing.command(state))
        motion = state.motion
        self._server.gui.set_panel_label(f"{SIGNS[motion]}  {NAMES[motion]}")
        self._label.text = NAMES[motion]
        best = int(motion) if np.isfinite(state.scores).all() else None
        self._set(self._why, drawing.bars("Why: what each motion would teach", state.scores, best, 1, "bits"))
        self._set(self._counts, drawing.counts(state))
        self._set(self._marked, drawing.mark(state))
        self._set(self._commands, drawing.bars("Advice so far", state.told, best, 0, "times"))
        self._set(self._curves, drawing.curves(self._history.curves))
        way = self._history.way
        if len(way) > 1:
            self._way.points, self._way.visible = np.stack((way[:-1], way[1:]), axis=1).astype(np.float32), True
        if self._about.person and state.follows is not None and self._follow.value != state.follows:
            self._follow.value = state.follows

    def _set(self, element: Any, content: str) -> None:
        """New content, unless it is what stands there."""
        padded = f'<div style="padding:0 12px">{content}</div>'
        if element.content != padded:
            element.content = padded

    # Buttons ----------------------------------------------------------------------------------------------------------

    def _toggle(self) -> None:
        self._pause_or_go_on(not self._paused)

    def _step(self) -> None:
        self._pause_or_go_on(True)
        self._wish(STEP, True)

    def _pause_or_go_on(self, paused: bool) -> None:
        self._paused = paused
        self._pause.label = "Go on" if paused else "Pause"
        self._pause.icon = viser().Icon.PLAYER_PLAY if paused else viser().Icon.PLAYER_PAUSE
        self._wish(PAUSE, paused)
        if self._state is not None:
            self._set(self._standing, drawing.standing(self._state, paused))

    def _mark_middle(self) -> None:
        if self._state is not None:
            self._wish(MARK, drawing.middle_feature(self._state))

    def _mark_clicked(self, event: Any) -> None:
        """Mark the feature nearest to the ray of the click; the marked one again: none."""
        state = self._state
        if state is None or not len(state.ids):
            return
        sights = state.points - np.array(event.ray_origin)
        along = sights @ np.array(event.ray_direction)
        away = np.linalg.norm(sights - along[:, None] * np.array(event.ray_direction), axis=1) / np.maximum(along, 0.05)
        id = int(state.ids[away.argmin()])
        self._wish(MARK, 0 if id == state.marked else id)

    def _save(self, event: Any) -> None:
        """The map to the browser, and all to the recording's folder."""
        if self._state is not None and event.client is not None:
            event.client.send_file_download("map.csv", _table(self._state).encode(), save_immediately=True)
        self._wish(SAVE, True)


def _quiet_server(host: str, port: int, guard: Guard) -> Any:
    """A server that says nothing on the terminal, opens no tunnel, and answers only those that ``guard`` lets in."""
    made = viser()

    class Private(made.ViserServer):  # type: ignore[name-defined, misc]
        """Any client may ask for a public address; it gets none."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # strangers that talk nonsense
    stdout, sys.stdout = sys.stdout, open("/dev/null", "w")  # noqa: SIM115
    try:
        with guarding(guard):
            return Private(host, port, verbose=False)
    finally:
        sys.stdout = stdout


def _table(state: State) -> str:
    """The map as `track` writes it."""
    stds = np.sqrt(np.maximum(np.einsum("nii->ni", state.covariances), 0.0))
    rows = [
        ",".join((str(id), *(f"{value:.6f}" for value in (*point, *std))))
        for id, point, std in zip(state.ids.tolist(), state.points, stds)
    ]
    return "\n".join(("id,x,y,z,std_x,std_y,std_z", *rows, ""))


def _axes(covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-lengths (n, 3) [m], bounded, and orientations (n, 4), scalar first, of ellipsoids of ``covariances``."""
    from scipy.spatial.transform import Rotation

    squares, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, not a reflection
    sizes = np.clip(SIGMAS * np.sqrt(np.maximum(squares, 0.0)), 0.02, _LONGEST)
    return sizes, Rotation.from_matrix(axes).as_quat(scalar_first=True)


def _ball(rings: int = 9, spokes: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and faces (f, 3) of a unit ball."""
    polar, round = np.linspace(0.0, np.pi, rings), np.linspace(0.0, 2.0 * np.pi, spokes, endpoint=False)
    a, b = np.meshgrid(polar, round, indexing="ij")
    vertices = np.stack((np.sin(a) * np.cos(b), np.cos(a), np.sin(a) * np.sin(b)), axis=-1).reshape(-1, 3)
    faces = []
    for i in range(rings - 1):
        for j in range(spokes):
            here, right = i * spokes + j, i * spokes + (j + 1) % spokes
            faces += [(here, right, here + spokes), (right, right + spokes, here + spokes)]
    return vertices.astype(np.float32), np.array(faces, np.uint32)


def _edges(size: tuple[float, float, float]) -> np.ndarray:
    """The twelve edges (12, 2, 3) of a room about the origin."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * np.array(size) / 2
    pairs = [(a, b) for a in range(8) for b in range(a) if np.count_nonzero(corners[a] != corners[b]) == 1]
    return corners[np.array(pairs)].astype(np.float32)
