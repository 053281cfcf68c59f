"""A photograph of the room: image = f(scene, pose and velocity, lens, sensor, frame, key), and nothing else.

So it does not depend on what was seen before, on the policy, on the thread, or on being one of a batch.
"""

from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import camera_from_world, pixel_jacobian
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import compiled
from activeslam_gym.motion import QUATERNION
from activeslam_gym.vision.room.geometry import Scene
from activeslam_gym.vision.room.lens import TILE, TILE_HEIGHT, TILE_WIDTH, Lens
from activeslam_gym.vision.room.sensor import PAD, Sensor, develop, extend, smear, soften
from activeslam_gym.vision.room.shading import COLOUR, REST, Tile, add_rectangle, empty_tile
from activeslam_gym.vision.room.visibility import SIGHT, candidates, inverse_depth_at, look

_STILL = 1.0  # where nothing flows farther than that during the exposure [px], there is no blur


class Workspace(NamedTuple):
    """Arrays to work in, one set for each thread; nothing in them is kept from an image to the next."""

    sights: np.ndarray  # (S,) of SIGHT: the rectangles that the camera sees
    near: np.ndarray  # (S,) those of a tile
    tile: Tile  # the one that is being drawn
    flows: np.ndarray  # (tiles, 2) how far the picture moves during the exposure [px]
    sharp: np.ndarray  # pictures float32, whole tiles with a margin of PAD around them
    soft: np.ndarray


def workspace_of(scene: Scene, lens: Lens) -> Workspace:
    """The arrays for pictures of such a scene through that lens."""
    tiles, surfaces = lens.rays.shape[0], scene.surfaces.shape[0]
    shape = (tiles // lens.columns * TILE_HEIGHT + 2 * PAD, lens.columns * TILE_WIDTH + 2 * PAD)
    sharp, soft = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    sights, near = np.zeros(surfaces, SIGHT), np.zeros(surfaces, np.int64)
    return Workspace(sights, near, empty_tile(), np.zeros((tiles, 2)), sharp, soft)


@compiled
def render(
    scene: Scene, lens: Lens, sensor: Sensor, state: np.ndarray, frame: int, key: np.ndarray, work: Workspace,
    image: np.ndarray,
) -> None:  # fmt: skip
    """Photograph the scene into ``image`` (H, W) uint8.

    ``state`` (13,) is the camera's in the middle of the exposure: position, quaternion, velocity, angular velocity
    (world frame). ``key`` (1,) uint64 is the stream of the noise, of which frame k uses its own part.
    """
    _expose(scene, lens, state, work)
    extend(work.sharp)
    soften(work.sharp, sensor.side, work.soft)
    if sensor.exposure > 0.0 and _flow(lens, sensor.exposure, state, work) > _STILL:
        smear(work.soft, work.flows, lens.columns, work.sharp)
        develop(work.sharp, sensor, frame, key, image)
    else:
        develop(work.soft, sensor, frame, key, image)


@compiled
def _expose(scene: Scene, lens: Lens, state: np.ndarray, work: Workspace) -> None:
    """The light in each pixel into ``work.sharp`` [grey levels]; the inverse depth of each tile into ``work.flows``."""
    count = look(scene, state, lens.image_bounds, work.sights)
    for tile in range(lens.rays.shape[0]):
        bounds, rays = lens.bounds[tile], lens.rays[tile].reshape(-1)
        found, covered = candidates(work.sights, count, bounds, work.near)
        work.tile.floats[REST : REST + TILE] = np.float32(1.0)
        work.tile.floats[COLOUR : COLOUR + TILE] = np.float32(0.0)
        work.flows[tile, 0] = 0.0
        for k in range(found):
            sight = work.sights[work.near[k]]
            texture = scene.textures[sight.texture].reshape(-1)
            add_rectangle(sight, covered and k == found - 1, rays, texture, work.tile)
            if work.flows[tile, 0] == 0.0:
                x, y = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3])
                work.flows[tile, 0] = inverse_depth_at(sight, x, y)
        _hang(work.tile.floats, tile, lens.columns, work.sharp)


@compiled
def _hang(floats: np.ndarray, tile: int, columns: int, picture: np.ndarray) -> None:
    """Put a tile into its place; where shares do not add up to one quite, they are made to."""
    v, u = PAD + TILE_HEIGHT * (tile // columns), PAD + TILE_WIDTH * (tile % columns)
    one, tiny = np.float32(1.0), np.float32(1e-6)
    for i in range(TILE_HEIGHT):
        row = picture[v + i]
        for j in range(TILE_WIDTH):
            at = TILE_WIDTH * i + j
            row[u + j] = floats[COLOUR + at] / max(one - floats[REST + at], tiny)


@compiled
def _flow(lens: Lens, exposure: float, state: np.ndarray, work: Workspace) -> float:
    """How far [px] the middle of each tile moves during the exposure, into ``work.flows``; the farthest.

    A point at p_C moves by dp_C/dt = -R^T (v + w x R p_C) in the camera. ``work.flows`` holds 1/depth of each tile.
    """
    R_WC = rotation_matrix(state[QUATERNION])
    v_C = camera_from_world(R_WC, (state[7], state[8], state[9]))
    w_C = camera_from_world(R_WC, (state[10], state[11], state[12]))
    J, farthest = np.zeros((2, 3)), 0.0
    for tile in range(work.flows.shape[0]):
        bounds, inverse_depth = lens.bounds[tile], work.flows[tile, 0]
        x, y = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3])
        pixel_jacobian(lens.camera, (x, y, 1.0), J)  # at depth one, where the velocity is divided by the depth
        moved = (
            -inverse_depth * v_C[0] - (w_C[1] - w_C[2] * y),
            -inverse_depth * v_C[1] - (w_C[2] * x - w_C[0]),
            -inverse_depth * v_C[2] - (w_C[0] * y - w_C[1] * x),
        )
        for i in range(2):
            work.flows[tile, i] = exposure * (J[i, 0] * moved[0] + J[i, 1] * moved[1] + J[i, 2] * moved[2])
            farthest = max(farthest, abs(work.flows[tile, i]))
    return farthest
