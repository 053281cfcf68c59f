"""Scenes: what hides landmarks and stops the camera.

`boxes` is compiled, and the default. Another scene is a class with the methods of `Scene`, and
``gymnasium.make("ActiveSLAM-v0", scene=Mine)`` runs it; ``scene="flat.glb"``, or another mesh, needs none. The walls of
the room stop the camera in every scene.

What makes a scene may have a method ``fitted(scenario)``, which gives the scenario the room that it needs; and a scene
a method ``start(rng)``, a place (3,) where the camera may start.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from activeslam_gym.camera import hidden
from activeslam_gym.config import BOXES, NoRoomError, Scenario
from activeslam_gym.registry import array_of, asked, name_of
from activeslam_gym.world.furniture import draw_boxes, first_hits, inside_any, surface_points

_ROUNDING = 1e-6  # of what a scene answers, which may be in single precision
AROUND = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0
AROUND /= np.linalg.norm(AROUND, axis=1)[:, None]
"""(26, 3) unit vectors, along which bodies near a point are looked for."""


class Scene(Protocol):
    """The bodies of one episode. ``Scene(scenario, rng)`` makes one at each reset, by draws of ``rng`` alone."""

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest corner of all bodies, inside the scenario's room [m]."""

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(n,) bool: whether a body cuts the lines of sight from the point ``a`` (3,) to the points ``b`` (n, 3). A
        surface on which an end lies does not."""

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        """(n,) how far points can go from ``p`` (n, 3), in the room, along unit vectors ``directions`` (n, 3) before
        they meet a body: ``farthest`` at most, and 0 inside of one [m]."""

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``n`` points (n, 3) [m] on surfaces, where landmarks are, and the unit normals (n, 3) out of the bodies."""


_BATCHES = 60  # so often points on surfaces are drawn, until there are enough


class BoxScene:
    """``boxes`` (B, 2, 3), lowest and highest corners [m], in a room of ``half`` (3,) its size [m]."""

    def __init__(self, half: np.ndarray, boxes: np.ndarray) -> None:
        self.half, self.boxes = half, boxes

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) those of the room."""
        return np.stack((-self.half, self.half))

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Whether a box does."""
        return np.array([hidden(self.boxes, np.asarray(a, float), point) for point in np.asarray(b, float)], bool)

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        """To the first box or wall."""
        free = [first_hits(self.boxes, self.half, one, way[None])[0] for one, way in zip(p, directions, strict=True)]
        return np.where(inside_any(p, self.boxes), 0.0, np.clip(free, 0.0, farthest))

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Uniform on walls and boxes; see `furniture.surface_points`."""
        found = np.zeros((0, 6))
        for _ in range(_BATCHES):
            found = np.concatenate((found, surface_points(self.half, self.boxes, n, rng)))
            if len(found) >= n:
                return found[:n, :3], found[:n, 3:]
        raise NoRoomError(f"scenario.boxes hide the walls and each other: {len(found)} of {n} points found a place")


def draw_box_scene(scenario: Scenario, rng: np.random.Generator) -> BoxScene:
    """The scenario's own boxes, and those that it draws."""
    return BoxScene(0.5 * np.array(scenario.room_size), draw_boxes(scenario, rng))


SCENES: Mapping[str, Any] = MappingProxyType({BOXES: draw_box_scene})
"""The package's own scenes by name."""


class CheckedScene:
    """A foreign scene. An answer of another form is a ValueError that names the scene, the method and the answer."""

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        self._of, self._scene = f"of the scene {name_of(scenario.scene)!r}", scene
        self._half = half = 0.5 * np.array(scenario.room_size)
        self._slack = slack = _ROUNDING * max(1.0, half.max())
        self.start = self._start if hasattr(scene, "start") else None
        self.bounds = low, high = self._answer("bounds", lambda: scene.bounds, (2, 3))
        if not ((-half - slack <= low) & (low < high) & (high <= half + slack)).all():
            room = f"its lowest and highest corner, inside of ±{half.tolist()}"
            raise ValueError(f"bounds {self._of} must be {room}, got {self.bounds.tolist()}")

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """`Scene.blocks`."""
        return self._answer("blocks()", lambda: self._scene.blocks(a.copy(), b.copy()), (len(b),), bool)

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        """`Scene.clearance`."""
        asked_of = self._scene.clearance
        inside = np.clip(p, -self._half, self._half)  # rays beside a camera that touches a wall begin beyond it
        free = self._answer("clearance()", lambda: asked_of(inside, directions.copy(), farthest), (len(p),))
        if not ((0.0 <= free) & (free <= farthest * (1.0 + _ROUNDING))).all():
            raise ValueError(f"clearance() {self._of} must return numbers from 0 to {farthest:g}, got {free!r}")
        return np.where(free < farthest * (1.0 - _ROUNDING), free, farthest)

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """`Scene.sample`."""
        points, normals = self._answer("sample()", lambda: self._scene.sample(n, rng), (2, n, 3))
        low, high = self.bounds
        if not ((low - self._slack <= points) & (points <= high + self._slack)).all():
            raise ValueError(f"sample() {self._of} must return points inside of its bounds")
        if (np.abs(np.linalg.norm(normals, axis=1) - 1.0) > _ROUNDING).any():
            raise ValueError(f"sample() {self._of} must return normals of length 1, got {normals!r}")
        return points, normals

    def _start(self, rng: np.random.Generator) -> np.ndarray:
        place = self._answer("start()", lambda: self._scene.start(rng), (3,))  # type: ignore[attr-defined]
        if (np.abs(place) > self._half).any():
            raise ValueError(f"start() {self._of} must be inside of ±{self._half.tolist()}, got {place.tolist()}")
        return place

    def _answer(
        self, name: str, answer: Callable[[], Any], shape: tuple[int, ...], kind: type[float | bool] = float
    ) -> np.ndarray:
        what = f"{name} {self._of}"
        array = array_of(what, asked(what, answer), shape, kind)
        if not np.isfinite(array).all():
            raise ValueError(f"{what} must be finite, got {array!r}")
        return array
