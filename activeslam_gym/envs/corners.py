"""The sensor `corners`: what the front end of `images` would find in the same room, without an image.

A feature is a corner of a texture. It is searched as the front end would search it, found where it is in view, and new
ones are initialised as there. So a policy is trained at many times the speed of images, in the same rooms.
"""

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import change_of_view, view_of, visible
from activeslam_gym.envs.images import account_scene
from activeslam_gym.envs.run import Run, present
from activeslam_gym.envs.setting import Setting
from activeslam_gym.kernels import Record, compiled, filled, record
from activeslam_gym.linalg import copy_into
from activeslam_gym.slam.belief import feature_capacity, positions_of
from activeslam_gym.slam.estimate import index_of
from activeslam_gym.slam.frame import use_identified
from activeslam_gym.slam.initialisation import give_birth
from activeslam_gym.slam.kalman import feel_contact, predict, wander
from activeslam_gym.slam.map import remove_id
from activeslam_gym.slam.sight import INSIDE, sight_of_belief
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.room import patterns
from activeslam_gym.vision.room.geometry import Scene as Room
from activeslam_gym.vision.room.scene import draw_scene
from activeslam_gym.vision.room.shading import SIZE
from activeslam_gym.vision.room.textures import texture_library, texture_range
from activeslam_gym.vision.settings import SIGHTED
from activeslam_gym.vision.templates import TEMPLATE_HALF
from activeslam_gym.world.noise import normal_pair, uniforms
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.simulator import boxes_of, faces

FEATURE_STD, FIDUCIAL_STD = 0.04, 0.04
"""Deviations of the matches of images [px]: the medians of two episodes of `gallery-pixels`."""
_SPREAD = 0.6  # deviation of the logarithm of a feature's
_EDGE = TEMPLATE_HALF + 2.0  # what is nearer to the image's border is not found [px]
_BIRTH_EDGE = _EDGE + 6.0
_FACING = 0.26  # cosine of the greatest angle at which a corner is seen
_LOG_RATIO = 4.0  # of a match: what its looks say for it
_SIDE = 64  # texels, along a side, of the level of a texture in which its corners are
_MOST = 60  # corners of a texture

RULES = record(
    drift="f8", most_change="f8", scout_area="f8", gate="f8", least_share="f8", memory="f8", least_success="f8",
    enough="f8", spacing="f8", births="i8", births_every="i8", visible="i8", room_below="i8",
)  # fmt: skip
"""The front end's rules of what is searched, believed, deleted and initialised; see `FrontEndSettings`."""
MEMORY = record(
    id="i8",  # of the feature; 0: none
    corner="i8",  # that it follows
    std="f8",  # of its matches, each axis [px]
    first_seen=("f8", 3),  # where the camera was [m]
    tried="f8",  # searches, of which later ones count more
    matched="f8",  # those of them that were matched
    seen="i8",  # frame of the last match
)
"""What the front end would remember of a feature."""


class Corners(NamedTuple):
    """What can be seen in one run's room, and what is remembered of it."""

    points: np.ndarray  # (n, 3) [m], in random order
    normals: np.ndarray  # (n, 3) of the surfaces that they are on
    memory: np.ndarray  # (F,) of MEMORY
    spare: np.ndarray  # (N, 3) the truth of the slots of the score that have no feature [m]
    noise_key: np.ndarray  # (1,) uint64 the stream of the noise, of which frame k uses its own part


class Glance:
    """The corners of one run's room, and what the front end remembers of the features.

    ``start`` (7,): the pose at which the belief expects the camera first.
    """

    scene: Scene | None = None

    def __init__(self, setting: Setting, run: Run, start: np.ndarray, seed: np.random.SeedSequence) -> None:
        room, noise = seed.spawn(2)
        scene, s = draw_scene(setting.scenario, np.random.default_rng(room), start), SIGHTED
        run.world.fiducials[:] = scene.target
        run.world.boxes[:] = scene.boxes
        run.world.state.boxes = len(scene.boxes)
        points, normals = corners_of(scene)
        order = np.random.default_rng(noise).permutation(len(points))
        memory, key = np.zeros(feature_capacity(setting.scenario), MEMORY), noise.generate_state(1, np.uint64)
        self.corners = Corners(points[order], normals[order], memory, run.world.landmarks.copy(), key)
        self._rules = filled(RULES, s, enough=(1.0 - s.memory**s.trials) / (1.0 - s.memory))

    def begin(self, run: Run) -> None:
        """Write the prior."""
        present(run)

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Search the features in view, under the known accelerations ``u`` (6,), and initialise others."""
        glance(run, self._rules, self.corners, u, contact)


@compiled
def glance(run: Run, rules: Record, corners: Corners, u: np.ndarray, contact: bool) -> None:
    """A frame after the camera has moved: predict, search, forget, initialise, and account for it."""
    motion, belief, memory, frame = run.models.motion, run.ekf, corners.memory, run.world.state.frame + 1
    if contact:
        feel_contact(belief, u, motion.dt)
    predict(motion, belief, u, motion.dt)
    wander(belief, rules.drift / run.models.camera.focal, motion.dt)
    things, most = memory.shape[0] + run.world.fiducials.shape[0], 2 + 4 * rules.births
    luck = uniforms(corners.noise_key, frame * (2 * things + most), 2 * things + most)
    found = _search(run, rules, corners, luck)
    for entry in memory:
        if entry.id > 0 and entry.tried >= rules.enough and entry.matched < rules.least_success * entry.tried:
            remove_id(run.ekf, entry.id)
            entry.id = 0
            run.episode.events.deletions += 1
    run.episode.detections = found + _give_births(run, rules, corners, luck[2 * things :], found)
    present(run)
    estimate = run.estimate
    points = np.empty((estimate.state.count, 3))
    for entry in memory:
        k = index_of(estimate, entry.id) if entry.id > 0 else -1
        if k >= 0:
            copy_into(points[k], corners.points[entry.corner])
            copy_into(run.first_seen[k], entry.first_seen)
    account_scene(run, points, corners.spare)


@compiled
def _search(run: Run, rules: Record, corners: Corners, luck: np.ndarray) -> int:
    """Search what is in view of the belief, and update it; returns how many candidates were found."""
    models, belief, fiducials, memory = run.models, run.ekf, run.world.fiducials, corners.memory
    K, pose, frame = fiducials.shape[0], run.world.state.camera, run.world.state.frame + 1
    sight = sight_of_belief(models.camera, belief, fiducials, run.world.boxes[:0])
    view = view_of(models.true_camera, pose, boxes_of(run.world))
    believed, z = positions_of(belief), np.empty(2)
    v, found, searched = sight.thing.shape[0], 0, 0
    tried = np.zeros(v, np.bool_)
    for i in range(v):
        thing = sight.thing[i]
        m = _place(memory, thing.id) if thing.id > 0 else -1
        if m >= 0:
            change = change_of_view(memory[m].first_seen, belief.state.camera, believed[thing.row - K])
            if change > rules.most_change:
                continue
        a, b, d = sight.S[2 * i, 2 * i], sight.S[2 * i, 2 * i + 1], sight.S[2 * i + 1, 2 * i + 1]
        det = max(a * d - b * b, 1e-12)
        if math.pi * rules.gate * math.sqrt(det) > rules.scout_area:
            continue
        tried[i] = True
        searched += 1
        point = corners.points[memory[m].corner] if m >= 0 else fiducials[-1 - thing.id]
        if not visible(view, point, -_EDGE, z) or found == run.candidate.shape[0]:
            continue
        if m >= 0 and not faces(corners.normals[memory[m].corner], point, pose, _FACING):
            continue
        x, y = z[0] - thing.z_hat[0], z[1] - thing.z_hat[1]
        if (d * x * x - 2.0 * b * x * y + a * y * y) / det > rules.gate:
            continue
        std = memory[m].std if m >= 0 else FIDUCIAL_STD
        one = run.candidate[found]
        one.id, one.match, one.log_ratio = thing.id, 0, _LOG_RATIO
        first, second = normal_pair(luck[2 * i], luck[2 * i + 1])
        one.pixel[0], one.pixel[1] = z[0] + std * first, z[1] + std * second
        one.R[0, 0], one.R[0, 1], one.R[1, 0], one.R[1, 1] = std * std, 0.0, 0.0, std * std
        found += 1
    least = max(int(round(rules.least_share * searched)), 1)
    candidates = run.candidate[:found]
    use_identified(models, belief, fiducials, sight, candidates, least, run.episode.events)
    for i in range(v):
        thing = sight.thing[i]
        if tried[i] and thing.id > 0:
            matched = False
            for one in candidates:
                matched = matched or one.match == thing.id
            if matched or thing.visibility == INSIDE:
                entry = memory[_place(memory, thing.id)]
                entry.tried = rules.memory * entry.tried + 1.0
                entry.matched = rules.memory * entry.matched + matched
                entry.seen = frame if matched else entry.seen
    return found


@compiled
def _give_births(run: Run, rules: Record, corners: Corners, luck: np.ndarray, found: int) -> int:
    """Initialise features where few are in view, as candidates behind those ``found``; returns how many."""
    models, belief, state, memory = run.models, run.ekf, run.world.state, corners.memory
    K, pose, camera, frame = run.world.fiducials.shape[0], state.camera, models.camera, state.frame + 1
    sight = sight_of_belief(camera, belief, run.world.fiducials, run.world.boxes[:0])
    believed, v, crowd, in_view = positions_of(belief), sight.thing.shape[0], 0, 0
    occupied = np.empty((v + rules.births, 2))
    for i in range(v):
        thing = sight.thing[i]
        if thing.id > 0:
            first_seen = memory[_place(memory, thing.id)].first_seen
            if change_of_view(first_seen, belief.state.camera, believed[thing.row - K]) > rules.most_change:
                continue
        copy_into(occupied[crowd], thing.z_hat)
        across, down = thing.z_hat[0], thing.z_hat[1]
        in_view += _EDGE <= across < camera.width - _EDGE and _EDGE <= down < camera.height - _EDGE
        crowd += 1
    wanted = min(rules.births, rules.visible - in_view)
    if wanted <= 0 or not (frame % rules.births_every == 0 or 2 * in_view < rules.visible):
        return 0
    view, z, n, born = view_of(models.true_camera, pose, boxes_of(run.world)), np.empty(2), corners.points.shape[0], 0
    begin = int(luck[0] * n)
    for k in range(n):
        c = (begin + k) % n
        if born == wanted or found + born == run.candidate.shape[0]:
            break
        point = corners.points[c]
        if not faces(corners.normals[c], point, pose, _FACING) or not visible(view, point, -_BIRTH_EDGE, z):
            continue
        free = True
        for i in range(crowd):
            free = free and math.hypot(occupied[i, 0] - z[0], occupied[i, 1] - z[1]) > rules.spacing
        if not free:
            continue
        m = _place(memory, 0)
        if m < 0:
            m = _longest_unseen(memory, frame - 3)
            if m < 0 or in_view + born >= rules.room_below:
                break
            remove_id(belief, memory[m].id)
            memory[m].id = 0
        first, second = normal_pair(luck[4 * born + 2], luck[4 * born + 3])
        spread, _ = normal_pair(luck[4 * born + 4], luck[4 * born + 5])
        entry, one = memory[m], run.candidate[found + born]
        one.id, one.log_ratio = 0, 0.0
        entry.std = FEATURE_STD * math.exp(_SPREAD * spread)
        one.pixel[0], one.pixel[1] = z[0] + entry.std * first, z[1] + entry.std * second
        one.R[0, 0], one.R[0, 1], one.R[1, 0], one.R[1, 1] = entry.std**2, 0.0, 0.0, entry.std**2
        noise = camera.pixel_std**2 * np.eye(2)
        filter = models.filter
        one.match = give_birth(camera, filter.initialisation, filter.particles, belief, one.pixel, noise)
        if one.match <= 0:
            break
        entry.id, entry.corner, entry.seen, entry.tried, entry.matched = one.match, c, frame, 0.0, 0.0
        copy_into(entry.first_seen, belief.state.camera[:3])
        copy_into(occupied[crowd], z)
        crowd += 1
        born += 1
    run.episode.events.births += born
    return born


@compiled
def _place(memory: np.ndarray, id: int) -> int:
    """Where the feature ``id`` is in the memory, or -1; of 0: the first free place."""
    for m in range(memory.shape[0]):
        if memory[m].id == id:
            return m
    return -1


@compiled
def _longest_unseen(memory: np.ndarray, since: int) -> int:
    """The feature that was not matched for longest, before the frame ``since``, or -1."""
    best, earliest = -1, since
    for m in range(memory.shape[0]):
        if memory[m].id > 0 and memory[m].seen < earliest:
            best, earliest = m, memory[m].seen
    return best


@functools.lru_cache(maxsize=1)
def _texture_corners() -> tuple[np.ndarray, ...]:
    """Of each texture of the library, its corners (n, 2) as shares of its sides."""
    out, top = [], 2 * (SIZE - _SIDE)
    for texture in texture_library(0):
        grey = (texture[top : top + _SIDE, :_SIDE] & 255).astype(np.uint8)
        corners = new_corners(grey, np.zeros((0, 2)), _MOST, 4.0, 3, SIGHTED.least_corner, SIGHTED.least_ratio)
        out.append((corners + 0.5) / _SIDE)
    return tuple(out)


def corners_of(room: Room) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) the corners of all rectangles of a ``room`` but the target, and of their textures [m]; (n, 3) normals."""
    target, ends = texture_range(patterns.target), np.array(list(itertools.product((1e-6, 1.0 - 1e-6), repeat=2)))
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for k, surface in enumerate(room.surfaces):
        if surface["texture"] in target:
            continue
        own = _texture_corners()[int(surface["texture"])]
        if k < len(room.surfaces) - 6:  # the walls come last
            points.append(surface["corner"] + ends[:, :1] * surface["along"] + ends[:, 1:] * surface["down"])
            normals.append(np.tile(surface["normal"], (4, 1)))
        texel, texels = surface["texel"] / SIZE, surface["texels"] / SIZE
        low, high = np.floor(texel).astype(int), np.ceil(texel + texels).astype(int)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                share = (own + (i, j) - texel) / texels
                share = share[np.all((share > 0.0) & (share < 1.0), axis=1)]
                points.append(surface["corner"] + share[:, :1] * surface["along"] + share[:, 1:] * surface["down"])
                normals.append(np.tile(surface["normal"], (len(share), 1)))
    return np.concatenate(points), np.concatenate(normals)
