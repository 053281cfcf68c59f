"""The seam of scenes: what hides landmarks and stops the camera, chosen by ``scenario.scene``.

`boxes` is compiled, and the default. Another scene is a class with the methods of `Scene` in one file of its own:

    @SCENES.register("mine")
    class Mine: ...

and ``gymnasium.make("ActiveSLAM-v0", scenario={"scene": "mine"})`` runs it. The walls of the room stop the camera in
every scene.
"""

from numbers import Real
from typing import Any, Protocol

import numpy as np

from activeslam_gym.camera import hidden
from activeslam_gym.config import BOXES, NoRoomError, Scenario
from activeslam_gym.registry import Registry
from activeslam_gym.world.furniture import draw_boxes, first_hits, surface_points

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
    scene = SCENES[scenario.scene](scenario, rng)
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
        self._name, self._scene, half = scenario.scene, scene, 0.5 * np.array(scenario.room_size)
        self.bounds = low, high = self._array("bounds", scene.bounds, (2, 3))
        if not ((-half <= low) & (low < high) & (high <= half)).all():
            room = f"its lowest and highest corner, inside of ±{half.tolist()}"
            raise ValueError(f"bounds of the scene {self._name!r} must be {room}, got {self.bounds.tolist()}")

    def blocks(self, a: np.ndarray, b: np.ndarray) -> bool:
        """`Scene.blocks`."""
        blocked = self._scene.blocks(a, b)
        if not isinstance(blocked, (bool, np.bool_)):
            raise ValueError(f"blocks() of the scene {self._name!r} must return True or False, got {blocked!r}")
        return bool(blocked)

    def clearance(self, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
        """`Scene.clearance`."""
        free: Any = self._scene.clearance(p, direction, farthest)
        if not isinstance(free, Real) or not 0.0 <= float(free) <= farthest + 1e-9:
            raise ValueError(
                f"clearance() of the scene {self._name!r} must return a number from 0 to {farthest:g}, got {free!r}"
            )
        return min(float(free), farthest)

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """`Scene.sample`."""
        points, normals = self._array("sample(): points and normals", self._scene.sample(n, rng), (2, n, 3))
        low, high = self.bounds
        if not ((low - 1e-9 <= points) & (points <= high + 1e-9)).all():
            raise ValueError(f"sample() of the scene {self._name!r} must return points inside of its bounds")
        if (np.abs(np.linalg.norm(normals, axis=1) - 1.0) > 1e-6).any():
            raise ValueError(f"sample() of the scene {self._name!r} must return normals of length 1, got {normals!r}")
        return points, normals

    def _array(self, name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} of the scene {self._name!r} must be finite, of shape {shape}, got {value!r}")
        return array
