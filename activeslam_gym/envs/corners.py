"""The sensor `corners`: what the front end of `images` would find in the same room, without an image.

A feature is a corner of a texture. It is searched as the front end would search it, found where it is in view, and new
ones are initialised as there. So a policy is trained at many times the speed of images, in the same rooms.
"""

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import View, change_of_view, distance_between, view_of, visible
from activeslam_gym.envs.images import judge_by_scene
from activeslam_gym.envs.perception import Perception
from activeslam_gym.envs.run import Run, write_whole_estimate
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import evaluate_and_observe, read_command, sense_clearance, simulate
from activeslam_gym.kernels import Record, borrowing, compiled, filled, record
from activeslam_gym.linalg import copy_into
from activeslam_gym.slam.appearance import draw_bias, use_identified, wander
from activeslam_gym.slam.belief import feature_capacity, positions_of
from activeslam_gym.slam.estimate import add_offsets, index_of
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.map import add_landmark, remove_id
from activeslam_gym.slam.sight import INSIDE, sight_of_belief
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.room import textures
from activeslam_gym.vision.room.geometry import Scene as Room
from activeslam_gym.vision.room.scene import draw_scene
from activeslam_gym.vision.room.shading import SIZE
from activeslam_gym.vision.room.textures import texture_library, texture_range
from activeslam_gym.vision.settings import ENOUGH, SIGHTED
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE
from activeslam_gym.vision.views import is_outdated, speeds
from activeslam_gym.world.noise import normal_pair, uniforms
from activeslam_gym.world.simulator import boxes_of, faces

FEATURE_STD, FIDUCIAL_STD = 0.04, 0.04
"""Deviations of the matches of images [px]: the medians of two episodes of `gallery-pixels`."""
_SPREAD = 0.6  # deviation of the logarithm of a feature's
_EDGE = TEMPLATE_HALF + 2.0  # what is nearer to the image's border is not found [px]
_NEW_FEATURE_EDGE = _EDGE + 6.0
_FACING = 0.26  # cosine of the greatest angle at which a corner is seen
_TARGET_PX = 12.0  # where the target's first side looks shorter, its templates show too little to be found
_LOG_RATIO = 4.0  # of a match: what its looks say for it
_SIDES = (16, 32, 64, 128, 256)  # texels, along a side, of the levels of a texture that have corners of their own
_MOST = 60  # corners of a level

RULES = record(
    drift="f8", most_change="f8", largest_area="f8", gate="f8", trials="f8", enough="f8",
    initialised="i8", visible="i8", least_visible="i8", lost_after="i8", blur="f8",
    fiducial_bias_std="f8", redrawn="f8", feature_bias_std="f8", probation="f8",
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
    since="i8",  # and of the first one since it came into sight
)
"""What the front end would remember of a feature."""


DRAWN = record(
    pose=("f8", 7),  # of the camera for which a fiducial's template was drawn; NaN: for none
    bias=("f8", 2),  # by which it is found beside its pixel [px]
)
"""The template of a fiducial."""


class Corners(NamedTuple):
    """What can be seen in one run's room, and what is remembered of it."""

    points: np.ndarray  # (n, 3) [m], in random order
    normals: np.ndarray  # (n, 3) of the surfaces that they are on
    reach: np.ndarray  # (n, 2) between these distances each is a corner of the image [m]
    drawn: np.ndarray  # (K,) of DRAWN
    memory: np.ndarray  # (F,) of MEMORY
    spare: np.ndarray  # (N, 3) the truth of the slots of the score that have no feature [m]
    noise_key: np.ndarray  # (1,) uint64 the stream of the noise, of which frame k uses its own part


class CornerPerception(Perception):
    """The corners of one run's room, and what the front end remembers of the features.

    ``start`` (7,): the pose at which the belief expects the camera first.
    """

    def __init__(self, setting: Setting, run: Run, start: np.ndarray, seed: np.random.SeedSequence) -> None:
        room, noise = seed.spawn(2)
        scene = draw_scene(setting.scenario, np.random.default_rng(room), start)
        run.world.fiducials[:] = scene.target
        run.world.boxes[:] = scene.boxes
        run.world.state.boxes = len(scene.boxes)
        points, normals, reach = corners_of(scene, float(setting.models.true_lens.focal))
        order = np.random.default_rng(noise).permutation(len(points))
        memory, key = np.zeros(feature_capacity(setting.scenario), MEMORY), noise.generate_state(1, np.uint64)
        drawn = np.zeros(len(scene.target), DRAWN)
        drawn["pose"] = np.nan
        spare = run.world.landmarks.copy()
        self.corners = Corners(points[order], normals[order], reach[order], drawn, memory, spare, key)
        gate = setting.models.filter.appearance.search_gate
        self._rules = filled(RULES, SIGHTED.seen_through(float(setting.models.lens.focal)), gate=gate, enough=ENOUGH)

    def step(self, run: Run, command: np.ndarray) -> None:
        """`step.step`, in one kernel."""
        step_among_corners(run, self._rules, self.corners, command)


@compiled
def step_among_corners(run: Run, rules: Record, corners: Corners, command: np.ndarray) -> None:
    """`step.step`, in which each frame is `detect_corners`."""
    read_command(run, command, math.inf)
    for _ in range(run.models.task.frames_per_step):
        u, contact = simulate(run, command[3])
        detect_corners(run, rules, corners, u, contact)
    run.episode.steps += 1
    sense_clearance(run)
    evaluate_and_observe(run, False)


@compiled
def detect_corners(run: Run, rules: Record, corners: Corners, u: np.ndarray, contact: bool) -> None:
    """A frame after the camera has moved: predict, search, delete, initialise, and judge."""
    motion, belief, memory, frame = run.models.motion, run.ekf, corners.memory, run.world.state.frame + 1
    predict(motion, belief, u, motion.dt, contact)
    wander(belief, rules.drift / run.models.lens.focal, motion.dt)
    K = run.world.fiducials.shape[0]
    searched, most = memory.shape[0] + K, 2 + 4 * rules.initialised
    count = 2 * (searched + K) + most
    draws = uniforms(corners.noise_key, frame * count, count)
    _draw_target(run, rules, corners, draws[2 * searched + most :])
    found = _search(run, rules, corners, draws)
    for entry in memory:
        if entry.id > 0 and entry.tried >= rules.enough * rules.trials and 2.0 * entry.matched < entry.tried:
            remove_id(run.ekf, entry.id)
            entry.id = 0
            run.episode.events.deletions += 1
    run.episode.detection_count = found + _initialise_features(run, rules, corners, draws[2 * searched :], found)
    write_whole_estimate(run)
    points = np.empty((run.estimate.state.count, 3))
    for entry in memory:
        k = index_of(run.estimate, entry.id) if entry.id > 0 else -1
        if k >= 0:
            copy_into(points[k], corners.points[entry.corner])
            copy_into(run.first_seen[k], entry.first_seen)
    add_offsets(run.estimate, run.first_seen, rules.feature_bias_std / run.models.lens.focal)
    judge_by_scene(run, points, corners.spare)


@compiled
def _draw_target(run: Run, rules: Record, corners: Corners, draws: np.ndarray) -> None:
    """The fiducials whose view has changed are drawn for the one that is believed, and found with new biases."""
    belief, std = run.ekf, rules.fiducial_bias_std
    pose, fiducials = belief.state.camera, run.world.fiducials
    for k in range(fiducials.shape[0]):
        drawn = corners.drawn[k]
        if is_outdated(drawn.pose, pose, fiducials[k], rules.redrawn):
            copy_into(drawn.pose, pose[:7])
            first, second = normal_pair(draws[2 * k], draws[2 * k + 1])
            drawn.bias[0], drawn.bias[1] = std * first, std * second
            draw_bias(belief, fiducials.shape[0], k, std * std)


@compiled
def _search(run: Run, rules: Record, corners: Corners, draws: np.ndarray) -> int:
    """Search what is in view of the belief, and update it; returns how many detections there are."""
    models, belief, fiducials, memory = run.models, run.ekf, run.world.fiducials, corners.memory
    K, pose, frame = fiducials.shape[0], run.world.state.camera, run.world.state.frame + 1
    sight = sight_of_belief(models.lens, belief, fiducials, run.world.boxes[:0])
    view = view_of(models.true_lens, pose, boxes_of(run.world))
    believed, z = positions_of(belief), np.empty(2)
    v, found = sight.point.shape[0], 0
    reach = models.lens.focal * distance_between(fiducials[0], fiducials[1]) / _TARGET_PX
    tried, blur = np.zeros(v, np.bool_), rules.blur * speeds(models.lens, belief.state.camera, fiducials)
    for i in range(v):
        point = sight.point[i]
        m = _place(memory, point.id) if point.id > 0 else -1
        if m >= 0:
            change = change_of_view(memory[m].first_seen, belief.state.camera, believed[point.row - K])
            if change > rules.most_change:
                continue
        a, b, d = sight.S[2 * i, 2 * i], sight.S[2 * i, 2 * i + 1], sight.S[2 * i + 1, 2 * i + 1]
        det = max(a * d - b * b, 1e-12)
        tried[i] = True
        k = -1 - point.id
        place = corners.points[memory[m].corner] if m >= 0 else fiducials[k]
        if not visible(view, place, -_EDGE, z) or found == run.detections.shape[0]:
            continue
        near = m >= 0 or distance_between(pose, place) <= reach
        if not near or (m >= 0 and not faces(corners.normals[memory[m].corner], place, pose, _FACING)):
            continue
        x, y = z[0] - point.z_hat[0], z[1] - point.z_hat[1]
        gate = min(rules.gate, rules.largest_area / (math.pi * math.sqrt(det)))
        if (d * x * x - 2.0 * b * x * y + a * y * y) / det > gate:
            continue
        std = memory[m].std if m >= 0 else math.hypot(FIDUCIAL_STD, blur[k])
        one = run.detections[found]
        one.id, one.match, one.log_ratio = point.id, 0, _LOG_RATIO
        first, second = normal_pair(draws[2 * i], draws[2 * i + 1])
        one.pixel[0], one.pixel[1] = z[0] + std * first, z[1] + std * second
        if m < 0:
            one.pixel[0] += corners.drawn[k].bias[0]
            one.pixel[1] += corners.drawn[k].bias[1]
        elif not _is_proven(rules, memory[m]):
            std *= rules.probation
        one.R[0, 0], one.R[0, 1], one.R[1, 0], one.R[1, 1] = std * std, 0.0, 0.0, std * std
        found += 1
    detections = run.detections[:found]
    use_identified(models, belief, fiducials, sight, detections, 1, run.episode.events)
    for i in range(v):
        point = sight.point[i]
        if tried[i] and point.id > 0:
            matched = False
            for one in detections:
                matched = matched or one.match == point.id
            if matched or point.visibility == INSIDE:
                entry = memory[_place(memory, point.id)]
                keep = 1.0 - 1.0 / rules.trials
                entry.tried = keep * entry.tried + 1.0
                entry.matched = keep * entry.matched + matched
                if matched:
                    entry.since = frame if frame - entry.seen > rules.trials else entry.since
                    entry.seen = frame
    return found


@borrowing
def _is_proven(rules: Record, entry: Record) -> bool:
    """See `TemplateMap.proven`."""
    return entry.seen - entry.since >= rules.trials - 1 and entry.matched >= rules.enough * rules.trials


@compiled
def _initialise_features(run: Run, rules: Record, corners: Corners, draws: np.ndarray, found: int) -> int:
    """Initialise features where few are in view, as detections behind those ``found``; returns how many."""
    models, belief, state, memory = run.models, run.ekf, run.world.state, corners.memory
    K, pose, lens, frame = run.world.fiducials.shape[0], state.camera, models.lens, state.frame + 1
    sight = sight_of_belief(lens, belief, run.world.fiducials, run.world.boxes[:0])
    believed, v, crowd, in_view = positions_of(belief), sight.point.shape[0], 0, 0
    occupied = np.empty((v + rules.initialised, 2))
    for i in range(v):
        point = sight.point[i]
        if point.id > 0:
            first_seen = memory[_place(memory, point.id)].first_seen
            if change_of_view(first_seen, belief.state.camera, believed[point.row - K]) > rules.most_change:
                continue
        copy_into(occupied[crowd], point.z_hat)
        across, down = point.z_hat[0], point.z_hat[1]
        in_view += _EDGE <= across < lens.width - _EDGE and _EDGE <= down < lens.height - _EDGE
        crowd += 1
    wanted = min(rules.initialised, rules.visible - in_view)
    if wanted < rules.initialised:
        return 0
    view, z, n, born = view_of(models.true_lens, pose, boxes_of(run.world)), np.empty(2), corners.points.shape[0], 0
    begin = int(draws[0] * n)
    for k in range(n):
        c = (begin + k) % n
        if born == wanted or found + born == run.detections.shape[0]:
            break
        if not _may_be_shown(corners, c, view) or not visible(view, corners.points[c], -_NEW_FEATURE_EDGE, z):
            continue
        free = True
        for i in range(crowd):
            free = free and math.hypot(occupied[i, 0] - z[0], occupied[i, 1] - z[1]) > TEMPLATE_SIDE
        if not free:
            continue
        m = _place(memory, 0)
        if m < 0:
            m = _longest_unseen(memory, frame - rules.lost_after)
            if m < 0 or in_view + born >= rules.least_visible:
                break
            remove_id(belief, memory[m].id)
            run.episode.events.deletions += 1
            memory[m].id = 0
        first, second = normal_pair(draws[4 * born + 2], draws[4 * born + 3])
        spread, _ = normal_pair(draws[4 * born + 4], draws[4 * born + 5])
        entry, one = memory[m], run.detections[found + born]
        one.id, one.log_ratio = 0, 0.0
        entry.std = FEATURE_STD * math.exp(_SPREAD * spread)
        one.pixel[0], one.pixel[1] = z[0] + entry.std * first, z[1] + entry.std * second
        one.R[0, 0], one.R[0, 1], one.R[1, 0], one.R[1, 1] = entry.std**2, 0.0, 0.0, entry.std**2
        noise = lens.pixel_std**2 * np.eye(2)
        one.match = add_landmark(lens, models.filter.initialisation, models.filter.particles, belief, one.pixel, noise)
        if one.match <= 0:
            break
        entry.id, entry.corner, entry.tried, entry.matched = one.match, c, 0.0, 0.0
        entry.seen = entry.since = frame
        copy_into(entry.first_seen, belief.state.camera[:3])
        copy_into(occupied[crowd], z)
        crowd += 1
        born += 1
    run.episode.events.initialised += born
    return born


@borrowing
def _may_be_shown(corners: Corners, c: int, view: View) -> bool:
    """Whether ``c`` is before the camera, a corner at its distance, and shows its front: most of a room are not."""
    y, p, R_WC = corners.points[c], view.pose, view.R_WC
    if R_WC[0, 2] * (y[0] - p[0]) + R_WC[1, 2] * (y[1] - p[1]) + R_WC[2, 2] * (y[2] - p[2]) <= 0.0:
        return False
    reach = corners.reach[c]
    return reach[0] <= distance_between(p, y) < reach[1] and faces(corners.normals[c], y, p, _FACING)


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
def _texture_corners() -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Of each texture of the library, the corners (n, 2) of all its levels, as shares of its sides, and their levels
    (n,)."""
    out = []
    for texture in texture_library():
        shares, levels = [np.empty((0, 2))], []
        for level, side in enumerate(_SIDES):
            top = 2 * (SIZE - side)
            grey = (texture[top : top + side, :side] & 255).astype(np.uint8)
            corners = new_corners(grey, np.zeros((0, 2)), _MOST, 4.0, 3, SIGHTED.least_corner)
            shares.append((corners + 0.5) / side)
            levels += [level] * len(corners)
        out.append((np.concatenate(shares), np.array(levels, int)))
    return tuple(out)


def corners_of(room: Room, focal: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, 3) the corners of a ``room`` [m], (n, 3) normals, (n, 2) between which distances a camera of that ``focal``
    length [px] sees them as corners [m].

    They are those of rectangles, but not of walls and of boxes that look like the wall behind them, and of textures. A
    texture is drawn by the level whose texels are one to two pixels large, and has the corners of that level.
    """
    target, plain = texture_range(textures.target), texture_range(textures.plaster)
    ends, always = np.array(list(itertools.product((1e-6, 1.0 - 1e-6), repeat=2))), np.tile((0.0, np.inf), (4, 1))
    points, normals, reach = [], [], []
    for k, surface in enumerate(room.surfaces):
        shares, between = [np.empty((0, 2))], [np.empty((0, 2))]  # of the surface's sides, and the distances of each
        if k < len(room.surfaces) - 6 and surface["texture"] not in plain:  # the walls come last
            shares, between = [ends], [always]
        if surface["texture"] not in target:  # whose own corners are the fiducials
            texel, texels = surface["texel"] / SIZE, surface["texels"] / SIZE
            low, high = np.floor(texel).astype(int), np.ceil(texel + texels).astype(int)
            copies = np.array(list(itertools.product(range(low[0], high[0]), range(low[1], high[1]))))[:, None]
            sides = np.linalg.norm(surface["along"]), np.linalg.norm(surface["down"])
            extent = math.sqrt(sides[0] * sides[1] / texels.prod())  # of the whole texture [m]
            own, levels = _texture_corners()[int(surface["texture"])]
            share, level = ((own + copies - texel) / texels).reshape(-1, 2), np.tile(levels, len(copies))
            inside = np.flatnonzero(((share > 0.0) & (share < 1.0)).all(axis=1))
            kept = inside[np.argsort(level[inside], kind="stable")]  # an order that a seed's permutation relies on
            shares.append(share[kept])
            farthest = focal * extent / np.array(_SIDES)
            nearest = np.append(0.5 * farthest[:-1], 0.0)
            between.append(np.column_stack((nearest, farthest))[level[kept]])
        share = np.concatenate(shares)
        points.append(surface["corner"] + share[:, :1] * surface["along"] + share[:, 1:] * surface["down"])
        normals.append(np.broadcast_to(surface["normal"], points[-1].shape))
        reach += between
    return np.concatenate(points), np.concatenate(normals), np.concatenate(reach)
