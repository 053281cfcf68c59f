"""What a registered scene does to the true camera and to its detections.

`simulator` does the same for boxes, in kernels. Noise and order of the detections stay those of the counted stream.
"""

import numpy as np

from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.motion import MOTION_AXIS, MOTION_SIGN, POSITION, QUATERNION, VELOCITY
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.simulator import CLUTTER_LABEL, World

_MARGINS = 10.0
"""A surface is looked for so many wall margins ahead of the camera."""
_STEP = 1e-4
"""Between the rays that tell the slope of a surface [m]."""
_PUSHES = 4
"""So often the camera is pushed out of a surface in a frame; then it stays where it was."""


def reach(scene: Scene, motion: Record, p: np.ndarray, direction: np.ndarray, farthest: float) -> float:
    """How far the camera can go from ``p`` (3,) along the unit vector ``direction``, ``farthest`` at most [m].

    It ends the wall's margin before the scene's bodies.
    """
    margin = float(motion.wall_margin)
    return max(scene.clearance(p.copy(), direction, farthest + margin) - margin, 0.0)


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

    It ends the wall's margin before the tangent plane of the surface, and its velocity into that is zeroed.
    """
    margin, most = float(motion.wall_margin), motion.half - motion.wall_margin
    p, v, touched = world.state.camera[POSITION], world.state.camera[VELOCITY], 0
    for _ in range(_PUSHES):
        ahead = _surface_ahead(scene, start, p - start, margin)
        lack = margin - float(ahead[1] @ (p - ahead[0])) if ahead else 0.0
        if ahead is None or lack < 1e-9:
            return touched
        p[:] = np.clip(p + lack * ahead[1], -most, most)
        v -= min(float(v @ ahead[1]), 0.0) * ahead[1]
        touched = 1
    p[:], v[:] = start, 0.0
    return touched


def _surface_ahead(
    scene: Scene, start: np.ndarray, way: np.ndarray, margin: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Point (3,) and unit normal (3,) of the surface on the ``way`` (3,) from ``start`` and some margins farther.

    With distances f, f_x and f_y along three parallel rays d, the normal is that of -d + f'_x e_x + f'_y e_y.
    """
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return None
    d, farthest = way / length, length + _MARGINS * margin
    f = scene.clearance(start, d, farthest)
    if f >= farthest:
        return None
    normal = -d
    e_x = np.cross(d, np.eye(3)[np.abs(d).argmin()])
    for e in (e_x / np.linalg.norm(e_x), np.cross(d, e_x) / np.linalg.norm(e_x)):
        beside = scene.clearance(start + _STEP * e, d, farthest)
        if beside < farthest:
            normal = normal + (beside - f) / _STEP * e
    return start + f * d, normal / np.linalg.norm(normal)


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
