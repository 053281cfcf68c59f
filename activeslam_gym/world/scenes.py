"""The seam of scenes: what hides landmarks and stops the camera, chosen by ``scenario.scene``.

`boxes` is compiled, and the default. Another scene is a class with the methods of `Scene` in one file of its own:

    @SCENES.register("mine")
    class Mine: ...

and ``gymnasium.make("ActiveSLAM-v0", scenario={"scene": "mine"})`` runs it. The walls of the room stop the camera in
every scene.
"""

from collections.abc import Callable
from numbers import Real
from typing import Any, Protocol

import numpy as np

from activeslam_gym.camera import hidden
from activeslam_gym.config import BOXES, NoRoomError, Scenario
from activeslam_gym.registry import Registry, array_of, asked
from activeslam_gym.world.furniture import draw_boxes, first_hits, surface_points

_ROUNDING = 1e-6  # of what a scene answers, which may be in single precision
AROUND = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0
AROUND /= np.linalg.norm(AROUND, axis=1)[:, None]
"""(26, 3) unit vectors, along which bodies near a point are looked for."""


class Scene(Protocol):
    """The bodies of one episode. ``Scene(scenario, rng)`` makes one at each reset, by draws of ``rng`` alone."""

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest corner of all bodies, inside the scenario's room [m]."""

    def blocks(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether a body cuts the line of sight between the points ``a`` and ``b`` (3,). A surface on which one of
        them lies does not."""

    def clearance(self, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
        """How far a point can go from ``p`` (3,) along the unit vector ``direction`` (3,) before it meets a body:
        ``farthest`` at most, and 0 where it is inside of one [m]."""

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """``n`` points (n, 3) [m] on surfaces, where landmarks are, and the unit normals (n, 3) out of the bodies."""


_BATCHES = 60  # so often points on surfaces are drawn, until there are enough
SCENES: Registry[Any] = Registry("scenario.scene")  # the scenes by name


def draw_scene(scenario: Scenario, rng: np.random.Generator) -> Scene:
    """The scene of a reset; a wrong answer of a registered one is a ValueError."""
    scene = asked(f"the scene {scenario.scene!r}", SCENES[scenario.scene], scenario, rng)
    return CheckedScene(scenario, scene) if scenario.has_registered_scene else scene


class BoxScene:
    """``boxes`` (B, 2, 3), lowest and highest corners [m], in a room of ``half`` (3,) its size [m]."""

    def __init__(self, half: np.ndarray, boxes: np.ndarray) -> None:
        self.half, self.boxes = half, boxes

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) those of the room."""
        return np.stack((-self.half, self.half))

    def blocks(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether a box does."""
        return bool(hidden(self.boxes, np.asarray(a, float), np.asarray(b, float)))

    def clearance(self, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
        """To the first box or wall."""
        if ((self.boxes[:, 0] < p) & (p < self.boxes[:, 1])).all(axis=1).any():
            return 0.0
        return min(float(first_hits(self.boxes, self.half, p, np.asarray(direction)[None])[0]), farthest)

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Uniform on walls and boxes; see `furniture.surface_points`."""
        found = np.zeros((0, 6))
        for _ in range(_BATCHES):
            found = np.concatenate((found, surface_points(self.half, self.boxes, n, rng)))
            if len(found) >= n:
                return found[:n, :3], found[:n, 3:]
        raise NoRoomError(f"scenario.boxes hide the walls and each other: {len(found)} of {n} points found a place")


@SCENES.register(BOXES)
def draw_box_scene(scenario: Scenario, rng: np.random.Generator) -> BoxScene:
    """The scenario's own boxes, and those that it draws."""
    return BoxScene(0.5 * np.array(scenario.room_size), draw_boxes(scenario, rng))


class CheckedScene:
    """A registered scene. A wrong answer of it is a ValueError that names the scene, the method and the answer."""

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        self._of, self._scene, half = f"of the scene {scenario.scene!r}", scene, 0.5 * np.array(scenario.room_size)
        self._slack = _ROUNDING * max(1.0, half.max())
        self.bounds = low, high = self._array("bounds", lambda: scene.bounds, (2, 3))
        if not ((-half - self._slack <= low) & (low < high) & (high <= half + self._slack)).all():
            room = f"its lowest and highest corner, inside of ±{half.tolist()}"
            raise ValueError(f"bounds {self._of} must be {room}, got {self.bounds.tolist()}")

    def blocks(self, a: np.ndarray, b: np.ndarray) -> bool:
        """`Scene.blocks`."""
        blocked = asked(f"blocks() {self._of}", lambda: self._scene.blocks(a.copy(), b.copy()))
        if not isinstance(blocked, (bool, np.bool_)):
            raise ValueError(f"blocks() {self._of} must return True or False, got {blocked!r}")
        return bool(blocked)

    def clearance(self, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
        """`Scene.clearance`."""
        free: Any = asked(
            f"clearance() {self._of}", lambda: self._scene.clearance(p.copy(), direction.copy(), farthest)
        )
        most = farthest * (1.0 + _ROUNDING)
        real = isinstance(free, Real) and not isinstance(free, bool)
        if not real or not 0.0 <= free <= most:
            raise ValueError(f"clearance() {self._of} must return a number from 0 to {farthest:g}, got {free!r}")
        return float(free) if free < farthest * (1.0 - _ROUNDING) else farthest

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """`Scene.sample`."""
        points, normals = self._array("points and normals of sample()", lambda: self._scene.sample(n, rng), (2, n, 3))
        low, high = self.bounds
        if not ((low - self._slack <= points) & (points <= high + self._slack)).all():
            raise ValueError(f"sample() {self._of} must return points inside of its bounds")
        if (np.abs(np.linalg.norm(normals, axis=1) - 1.0) > _ROUNDING).any():
            raise ValueError(f"sample() {self._of} must return normals of length 1, got {normals!r}")
        return points, normals

    def _array(self, name: str, answer: Callable[[], Any], shape: tuple[int, ...]) -> np.ndarray:
        array = array_of(f"{name} {self._of}", asked(f"{name} {self._of}", answer), shape)
        if not np.isfinite(array).all():
            raise ValueError(f"{name} {self._of} must be finite, got {array!r}")
        return array
