"""What a registered scene does to the true camera and to its detections.

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


def reach(scene: Scene, motion: Record, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
    """How far the camera can go from ``p`` (3,) along the unit vector ``direction``, ``farthest`` at most [m].

    It ends the wall's margin before the tangent plane of the surface that it would meet.
    """
    margin, p = float(motion.wall_margin), p.copy()
    most = farthest + margin / _STEEPEST
    distance = scene.clearance(p, direction, most)
    if distance >= most:
        return farthest
    cosine = max(-float(direction @ _normal(scene, p, direction, distance, most)), _STEEPEST)
    return min(max(distance - margin / cosine, 0.0), farthest)


def reach_of_command(scene: Scene, motion: Record, world: World, command: np.ndarray) -> float:
    """How far the true camera can go in the direction of a ``command`` (>= 3,), of which 1 is a step [m]."""
    size = float(np.linalg.norm(command[:3]))
    if size == 0.0:
        return np.inf
    camera, farthest = world.state.camera, float(motion.step_length) * size + float(motion.goal_margin)
    return reach(scene, motion, camera[POSITION], rotation_matrix(camera[QUATERNION]) @ command[:3] / size, farthest)


def narrow_clearance(scene: Scene, motion: Record, world: World, clearance: np.ndarray) -> None:
    """Shorten ``clearance`` (7,), as `simulator.find_clearance` wrote it, to what the scene leaves."""
    p, R_WC = world.state.camera[POSITION], rotation_matrix(world.state.camera[QUATERNION])
    for index, (axis, sign) in enumerate(zip(MOTION_AXIS, MOTION_SIGN, strict=True)):
        clearance[index] = reach(scene, motion, p, sign * R_WC[:, axis], float(clearance[index]))
    clearance[-1] = clearance.min()


def push_out(scene: Scene, motion: Record, world: World, start: np.ndarray) -> int:
    """Push the true camera, which came from ``start`` (3,), out of a body that it ran into; 1 if it did, else 0.

    It ends the wall's margin before the tangent plane of each surface near it, and its velocity into that is zeroed.
    """
    margin, most = float(motion.wall_margin), motion.half - motion.wall_margin
    p, v = world.state.camera[POSITION], world.state.camera[VELOCITY]
    touched, look = _stop_before(scene, margin, p, v, start), _LOOK * margin
    for _ in range(_PUSHES):
        free = np.array([scene.clearance(p.copy(), way, look) for way in AROUND])
        nearest = int(free.argmin())
        normal = _normal(scene, p.copy(), AROUND[nearest], float(free[nearest]), look)
        lack = margin + float(free[nearest] * (AROUND[nearest] @ normal))
        if free[nearest] >= look or lack < 1e-9:
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
    d = (p - start) / length
    distance = scene.clearance(start, d, length)
    if distance >= length:
        return 0
    normal = _normal(scene, start, d, distance, length)
    p[:] = start + max(distance - margin, 0.0) * d
    v -= min(float(v @ normal), 0.0) * normal
    return 1


def _normal(scene: Scene, p: np.ndarray, d: np.ndarray, f: float, farthest: float) -> np.ndarray:
    """Unit normal (3,) of the surface that a ray from ``p`` along the unit vector ``d`` (3,) meets after ``f`` [m].

    It is that of -d + f'_x e_x + f'_y e_y: two parallel rays tell the slopes, 0 where they meet nothing.
    """
    normal, e_x = -d, np.cross(d, np.eye(3)[np.abs(d).argmin()])
    e_x /= np.linalg.norm(e_x)
    for e in (e_x, np.cross(d, e_x)):
        beside = scene.clearance(p + _STEP * e, d, farthest)
        if beside < farthest:
            normal = normal + (beside - f) / _STEP * e
    return normal / np.linalg.norm(normal)


def drop_hidden(scene: Scene, world: World, candidates: np.ndarray, labels: np.ndarray, count: int) -> int:
    """Of the leading ``count`` detections keep those that the scene does not hide, in their order; how many."""
    points, eye = np.concatenate((world.fiducials, world.landmarks)), world.state.camera[POSITION].copy()
    kept = [
        m
        for m, label in enumerate(labels[:count].tolist())
        if label == CLUTTER_LABEL or not scene.blocks(eye, points[label])
    ]
    candidates[: len(kept)], labels[: len(kept)] = candidates[kept], labels[kept]
    return len(kept)
