"""What a foreign scene does to the true camera and to its detections.

`simulator` does the same for boxes, in kernels. Noise and order of the detections stay those of the counted stream.
"""

import numpy as np

from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.motion import MOTION_AXIS, MOTION_SIGN, POSITION, QUATERNION, VELOCITY
from activeslam_gym.world.scenes import AROUND, Scene
from activeslam_gym.world.simulator import CLUTTER_LABEL, World

_STEP = 1e-4  # between the rays that tell the slope of a surface [m]
_STEEPEST = 0.1  # cosine between a ray and a normal, under which a surface counts as this steep
_LOOK = 1.14  # wall margins that the rays of `AROUND` are long, so that one meets every plane within a margin
_PUSHES = 4  # so often the camera is pushed out of a surface in a frame; then it stays where it was


def reach(scene: Scene, motion: Record, p: np.ndarray, directions: np.ndarray, farthest: np.ndarray) -> np.ndarray:
    """How far the camera can go from ``p`` (3,) along each of the unit vectors ``directions`` (n, 3): (n,) [m].

    At most as far as ``farthest`` (n,) says. It ends the wall's margin before the tangent plane of the surface that it
    would meet.
    """
    margin, origins = float(motion.wall_margin), np.repeat(p[None], len(directions), axis=0)
    most = float(np.max(farthest)) + margin / _STEEPEST
    distance = scene.clearance(origins, directions, most)
    normals = _normals(scene, origins, directions, distance, most)
    cosine = np.maximum(-np.sum(directions * normals, axis=1), _STEEPEST)
    return np.minimum(np.where(distance < most, np.maximum(distance - margin / cosine, 0.0), farthest), farthest)


def reach_of_command(scene: Scene, motion: Record, world: World, command: np.ndarray) -> float:
    """How far the true camera can go in the direction of a ``command`` (>= 3,), of which 1 is a step [m]."""
    size = float(np.linalg.norm(command[:3]))
    if size == 0.0:
        return np.inf
    camera, farthest = world.state.camera, float(motion.step_length) * size + float(motion.goal_margin)
    way = rotation_matrix(camera[QUATERNION]) @ command[:3] / size
    return float(reach(scene, motion, camera[POSITION], way[None], np.array([farthest]))[0])


def narrow_clearance(scene: Scene, motion: Record, world: World, clearance: np.ndarray) -> None:
    """Shorten ``clearance`` (7,), as `simulator.find_clearance` wrote it, to what the scene leaves."""
    p, R_WC = world.state.camera[POSITION], rotation_matrix(world.state.camera[QUATERNION])
    ways = np.array(MOTION_SIGN)[:, None] * R_WC[:, list(MOTION_AXIS)].T
    clearance[:-1] = reach(scene, motion, p, ways, clearance[:-1].copy())
    clearance[-1] = clearance.min()


def push_out(scene: Scene, motion: Record, world: World, start: np.ndarray) -> int:
    """Push the true camera, which came from ``start`` (3,), out of a body that it ran into; 1 if it did, else 0.

    It ends the wall's margin before the tangent plane of each surface near it, and its velocity into that is zeroed.
    """
    margin, most = float(motion.wall_margin), motion.half - motion.wall_margin
    p, v = world.state.camera[POSITION], world.state.camera[VELOCITY]
    touched, look = _stop_before(scene, margin, p, v, start), _LOOK * margin
    for _ in range(_PUSHES):
        here = np.repeat(p[None], len(AROUND), axis=0)
        free = scene.clearance(here, AROUND, look)
        nearest = int(free.argmin())
        if free[nearest] >= look:
            return touched
        one = slice(nearest, nearest + 1)
        normal = _normals(scene, here[one], AROUND[one], free[one], look)[0]
        lack = margin + float(free[nearest] * (AROUND[nearest] @ normal))
        if lack < 1e-9:
            return touched
        p[:] = np.clip(p + lack * normal, -most, most)
        v -= min(float(v @ normal), 0.0) * normal
        touched = 1
    p[:], v[:] = start, 0.0
    return touched


def _stop_before(scene: Scene, margin: float, p: np.ndarray, v: np.ndarray, start: np.ndarray) -> int:
    """Where the way from ``start`` to ``p`` goes through a surface, end it before; 1 if it does, else 0."""
    length = float(np.linalg.norm(p - start))
    if length == 0.0:
        return 0
    d, origin = (p - start)[None] / length, start[None]
    distance = scene.clearance(origin, d, length)
    if distance[0] >= length:
        return 0
    normal = _normals(scene, origin, d, distance, length)[0]
    p[:] = start + max(float(distance[0]) - margin, 0.0) * d[0]
    v -= min(float(v @ normal), 0.0) * normal
    return 1


def _normals(scene: Scene, p: np.ndarray, d: np.ndarray, f: np.ndarray, farthest: float) -> np.ndarray:
    """(n, 3) unit normals of the surfaces that rays from ``p`` (n, 3) along ``d`` (n, 3) meet after ``f`` (n,) [m].

    Each is that of -d + f'_x e_x + f'_y e_y: two parallel rays tell the slopes, 0 where they meet nothing.
    """
    e_x = np.cross(d, np.eye(3)[np.abs(d).argmin(axis=1)])
    e_x /= np.linalg.norm(e_x, axis=1)[:, None]
    e = np.stack((e_x, np.cross(d, e_x)))
    rays = np.broadcast_to(p + _STEP * e, e.shape).reshape(-1, 3), np.tile(d, (2, 1))
    beside = scene.clearance(*rays, farthest).reshape(2, -1, 1)
    slopes = np.where(beside < farthest, (beside - f[:, None]) / _STEP, 0.0)
    normals = -d + np.sum(slopes * e, axis=0)
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def drop_hidden(scene: Scene, world: World, candidates: np.ndarray, labels: np.ndarray, count: int) -> int:
    """Of the leading ``count`` detections keep those that the scene does not hide, in their order; how many."""
    points, eye = np.concatenate((world.fiducials, world.landmarks)), world.state.camera[POSITION].copy()
    real = labels[:count] != CLUTTER_LABEL
    kept = ~real
    kept[real] = ~scene.blocks(eye, points[labels[:count][real]])
    left = int(kept.sum())
    candidates[:left], labels[:left] = candidates[:count][kept], labels[:count][kept]
    return left
