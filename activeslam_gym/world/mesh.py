"""A triangle mesh as a scene: ``scene="flat.glb"``; a `MeshFactory`, or its fields, where its axes or its unit differ.

Rays by Embree (Wald, Woop, Benthin, Johnson and Ernst, "Embree: a kernel framework for efficient CPU ray tracing",
2014), of the extra ``mesh``. The room is the mesh's bounding box, whose middle is the world's origin.
"""

import functools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.sparse.csgraph import connected_components
from trimesh.transformations import rotation_matrix

from activeslam_gym.config import ANYWHERE, CENTRE, NoRoomError, Scenario
from activeslam_gym.config.bounds import is_number, plain
from activeslam_gym.world.scenes import AROUND

_UP = {"y": np.eye(4), "z": rotation_matrix(-0.5 * np.pi, (1.0, 0.0, 0.0))}  # to Y up
_SIDES = 0.5, 200.0  # of a room [m]
_AWAY, _MARGIN = 2e-3, 0.45  # a surface this near to a line's end does not cut it; free space around a start [m]
_ENCLOSED, _DRAWS, _PLACES = 0.8, 20_000, 200  # share of rays that meet a surface inside; places drawn, and kept


@dataclass(frozen=True)
class MeshFactory:
    """Scenes of the mesh in the file ``path``, whose axis ``up`` is y (as in glTF) or z, and whose ``unit`` is in m."""

    path: str
    up: str = "y"
    unit: float = 1.0

    def __post_init__(self) -> None:
        sound = isinstance(plain(self.path), str) and self.up in tuple(_UP) and is_number(plain(self.unit))
        if not sound or self.unit <= 0.0:
            raise ValueError(f"path must be a mesh's file, up y or z, and unit a positive number of metres, got {self}")

    def fitted(self, scenario: Scenario) -> Scenario:
        """The scenario with the room of the mesh, and a start where there is space."""
        if any(name == "room_size" for name, *_ in scenario.varied):
            raise ValueError(f"scenario.varied of a mesh must leave out room_size, got {scenario.varied!r}")
        size = tuple((np.ceil(2e3 * self(scenario, None).bounds[1] - 0.01) / 1e3).tolist())  # whole millimetres
        for name, own, free in ("room_size", size, Scenario().room_size), ("start", ANYWHERE, CENTRE):
            if (given := getattr(scenario, name)) not in (own, free):
                raise ValueError(f"scenario.{name} of a mesh must be left out, or {own!r}, got {given!r}")
        scene = scenario.scene if isinstance(scenario.scene, str) else self
        return replace(scenario, scene=scene, room_size=size, start=ANYWHERE)

    def __call__(self, scenario: Scenario, rng: np.random.Generator | None) -> "MeshScene":
        """The scene, the same at every reset."""
        if not Path(self.path).is_file():
            raise ValueError(f"scenario.scene must be the file of a mesh, got {self.path!r}")
        return _loaded(self, Path(self.path).stat().st_mtime_ns)


def _demand_plain_faces(path: str) -> None:
    """A ValueError, if a face of the OBJ file is not convex; or if faces count corners backwards and more corners
    follow, since trimesh counts from the last one of the file."""
    points, faces, backwards = list[list[str]](), list[list[int]](), False
    for line in Path(path).read_text(errors="replace").replace("\\\n", " ").splitlines():  # a \ continues a line
        kind, *words = line.split() or [""]
        if kind == "v":
            points.append(words[:3])
            if backwards:
                raise ValueError("faces count corners backwards, from the last one so far; export numbers from 1")
        elif kind == "f":
            numbers = [int(word.split("/")[0]) for word in words]  # from 1, or backwards from the last one so far
            backwards |= min(numbers) < 0
            faces.append([n - 1 if n > 0 else len(points) + n for n in numbers])
    _demand_convex(np.array(points, float), faces)


def _demand_convex_in_ply(mesh: trimesh.Trimesh) -> None:
    """A ValueError, if a face of the PLY file that trimesh has read is not convex."""
    corners, faces = (mesh.metadata["_ply_raw"][part]["data"] for part in ("vertex", "face"))
    names = faces if isinstance(faces, dict) else faces.dtype.names
    of = next(name for name in ("vertex_index", "vertex_indices", *names) if name in names)
    rings = faces[of] if isinstance(faces, dict) else faces[of]["f1"]  # "f0" counts them
    _demand_convex(np.column_stack([corners[axis] for axis in "xyz"]), rings)


def _demand_convex(points: np.ndarray, faces: Iterable[Any]) -> None:
    """A ValueError, if one of the ``faces``, each of indices of ``points`` (n, 3), has a notch: trimesh fills it."""
    polygons = dict[int, list[Any]]()  # by the number of corners
    for face in faces:
        if len(face) > 3:
            polygons.setdefault(len(face), []).append(face)
    for rings in polygons.values():
        corners = points[np.array(rings)]
        edges = np.roll(corners, -1, axis=1) - corners
        turns = np.cross(np.roll(edges, 1, axis=1), edges)
        normal = np.cross(edges[:, :-1], corners[:, :1] - corners[:, :-1]).sum(axis=1)  # twice the area
        if (np.einsum("mni,mi->mn", turns, normal) < -1e-6 * (normal**2).sum(axis=1)[:, None]).any():
            raise ValueError("a face of more than three corners is not convex; export triangles")


@functools.lru_cache(maxsize=8)
def _loaded(factory: MeshFactory, _: int) -> "MeshScene":
    name = f"scenario.scene: {factory.path!r}"
    try:
        if Path(factory.path).suffix.lower() == ".obj":
            _demand_plain_faces(factory.path)
        mesh = trimesh.load(factory.path, force="mesh")
        if not len(mesh.faces):
            raise ValueError("it has no faces")
        if Path(factory.path).suffix.lower() == ".ply":
            _demand_convex_in_ply(mesh)
        mesh.apply_scale(factory.unit).apply_transform(_UP[factory.up])
    except Exception as error:
        raise ValueError(f"{name} is no mesh that can be read: {error}") from error
    return MeshScene(mesh, name)


class MeshScene:
    """A ``mesh``, Y up, [m]; its middle becomes the origin. Errors begin with ``name``."""

    def __init__(self, mesh: trimesh.Trimesh, name: str) -> None:
        if not _SIDES[0] <= mesh.extents.max() <= _SIDES[1]:
            raise ValueError(f"{name} is of {mesh.extents} m, and a room's longest side of {_SIDES}: another unit?")
        self._mesh, self._name, self._rays = mesh.copy(), name, EmbreeScene()
        self._mesh.apply_translation(-mesh.bounds.mean(axis=0))
        self.bounds, self._share = np.array(self._mesh.bounds), self._mesh.area_faces / self._mesh.area
        TriangleMesh(self._rays, self._mesh.triangles.astype(np.float32))
        self._places = self._find_places(np.random.default_rng(0))

    def __reduce__(self) -> tuple:
        return MeshScene, (self._mesh, self._name)  # rays are not copied, but made again

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        """To the first surface."""
        rays, most = (np.float32(p), np.float32(directions)), np.full(len(p), farthest, np.float32)
        return np.minimum(self._rays.run(*rays, dists=most, query="DISTANCE").astype(float), farthest)

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Whether a surface does."""
        length = np.maximum(np.linalg.norm(b - a, axis=1), 1e-9)
        ways = (b - a) / length[:, None]
        return self.clearance(a + _AWAY * ways, ways, np.inf) < length - 2.0 * _AWAY

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """By area, of what is seen from some place of the camera; a surface faces that place."""
        points, normals = np.empty((0, 3)), np.empty((0, 3))
        for _ in range(50):
            chosen, weights = rng.choice(len(self._share), 4 * n, p=self._share), rng.dirichlet(np.ones(3), 4 * n)
            new, eye = np.einsum("nij,ni->nj", self._mesh.triangles[chosen], weights), rng.choice(self._places, 4 * n)
            seen, normal = ~self.blocks(eye, new), self._mesh.face_normals[chosen]
            normal = np.sign(np.sum((eye - new) * normal, axis=1))[:, None] * normal
            points, normals = np.vstack((points, new[seen])), np.vstack((normals, normal[seen]))
            if len(points) >= n:
                return points[:n], normals[:n]
        raise NoRoomError(f"scenario.landmark_count: {len(points)} of {n} found a surface that the camera can see")

    def start(self, rng: np.random.Generator) -> np.ndarray:
        """(3,) a place where the camera may start [m]."""
        return rng.choice(self._places)

    def _find_places(self, rng: np.random.Generator) -> np.ndarray:
        """(k, 3) places inside with space around, of the largest part that is connected by sight."""
        points = rng.uniform(self.bounds[0], self.bounds[1], (_DRAWS, 3))
        rays = np.repeat(points, len(AROUND), axis=0), np.tile(AROUND, (_DRAWS, 1))
        free = self.clearance(*rays, np.inf).reshape(_DRAWS, -1)
        space, met = (free > _MARGIN).all(axis=1), np.isfinite(free).mean(axis=1)
        inside = points[space & (met >= _ENCLOSED)][:_PLACES]
        if not len(inside):
            left = 100.0 * (1.0 - met[space].max(initial=0.0))
            cause = f"too many holes: {left:.0f} % of the rays from inside leave it" if space.any() else "no free space"
            raise NoRoomError(f"{self._name} has {cause}")
        part = connected_components(np.stack([~self.blocks(one, inside) for one in inside]), directed=False)[1]
        return inside[part == np.bincount(part).argmax()]
