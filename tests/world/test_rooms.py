"""Rooms in which open-loop policies fail: how they are drawn, occlusion, contact, and what the belief knows of both."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym
from activeslam_gym import SCENARIOS, Motion, Scenario
from activeslam_gym.camera import View, camera_of, free_way, hidden, visible
from activeslam_gym.config import ANYWHERE, CENTRE, CLUSTERS, CORNER, SURFACES, WALL
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import row
from activeslam_gym.motion import motion_of
from activeslam_gym.world import simulator
from activeslam_gym.world.furniture import PASSAGE, inside_any, reachable
from activeslam_gym.world.room import Room, draw_room, expected_points, varied

BOX = np.array([[[1.0, -1.0, -0.5], [2.0, 1.0, 0.5]]])
PLACES = ("office", "corridor", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
PILLARS = ((-0.4, -1.0, 1.2), (0.4, 1.0, 2.2)), ((0.25, -1.0, -0.2), (0.6, 1.0, 0.2))
OWN = {"pillars": Scenario(boxes=PILLARS), "near wall": Scenario(room_size=(6.0, 2.0, 1.5))}


def drawn(name: str, seed: int) -> tuple[Scenario, Room]:
    rng = np.random.default_rng(seed)
    scenario = varied((OWN | SCENARIOS)[name], rng)
    return scenario, draw_room(scenario, rng)


def least_gap(points: np.ndarray) -> float:
    """Between two of the points (n, 3) [m]."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    return float(gaps[~np.eye(len(points), dtype=bool)].min())


@pytest.mark.parametrize("rooms", [25, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", (*PLACES, *OWN, "paper"))
def test_rooms_are_sound(name: str, rooms: int) -> None:
    """Nothing in a box, the fiducials in view, and everything within reach."""
    for seed in range(rooms):
        scenario, room = drawn(name, seed)
        half, camera = 0.5 * np.array(scenario.room_size), camera_of(scenario)
        points = np.concatenate((room.fiducials, room.landmarks))
        assert points.shape == (scenario.fiducial_count + scenario.landmark_count, 3)
        assert (np.abs(points) <= half + 1e-9).all() and (np.abs(room.camera[:3]) < half - scenario.wall_margin).all()
        assert not inside_any(points, room.boxes, -1e-6).any()
        assert least_gap(points) >= scenario.point_spacing
        assert not inside_any(room.camera[None, :3], room.boxes, scenario.wall_margin).any()
        view, z = View(camera, room.camera, rotation_matrix(room.camera[3:7]), room.boxes), np.empty(2)
        assert all(visible(view, y, 0.0, z) for y in room.fiducials)
        assert reachable(scenario, room.boxes, room.place, scenario.wall_margin)
        assert (
            len(room.boxes) <= scenario.box_capacity and len(room.normals) == len(room.landmarks) * scenario.on_surfaces
        )
        for normal, y in zip(room.normals, room.landmarks):
            assert not hidden(room.boxes, y + 0.05 * normal, y) and (np.abs(y + 0.01 * normal) < half).all()


def test_landmarks_are_on_surfaces_by_area_and_in_clusters_they_are_near_each_other() -> None:
    box = ((-0.5, -1.0, 1.5), (0.5, 1.0, 2.5))
    scenario = Scenario(landmark_count=600, landmark_layout=SURFACES, boxes=(box,))
    room = draw_room(scenario, np.random.default_rng(0))
    on_wall = (np.abs(np.abs(room.landmarks[:, [0, 2]]) - 3.0) < 1e-9).any(axis=1)
    assert on_wall.mean() == pytest.approx(48.0 / 56.0, abs=0.05) and not on_wall.all()
    clusters = Scenario(landmark_count=200, landmark_layout=CLUSTERS, cluster_count=3, cluster_std=0.05)
    points = draw_room(clusters, np.random.default_rng(1)).landmarks
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 0.6
    assert len(np.unique(near, axis=0)) <= 3 and near.sum(axis=1).min() > 20


def test_points_are_apart_wherever_they_are_and_a_room_without_enough_space_is_refused() -> None:
    for layout in ("uniform", SURFACES, CLUSTERS):
        scenario = Scenario(landmark_layout=layout, point_spacing=0.25, cluster_std=0.6)
        room = draw_room(scenario, np.random.default_rng(3))
        points = np.concatenate((room.fiducials, room.landmarks))
        assert len(points) == 33 and least_gap(points) >= 0.25
    halves = ((-3.0, -1.0, 0.5), (3.0, 1.0, 3.0)), ((-3.0, -1.0, -3.0), (3.0, 1.0, -0.5))
    crowded = Scenario(point_spacing=0.5, fiducial_count=0, landmark_count=200, boxes=halves)
    with pytest.raises(RuntimeError, match="'paper': its landmarks do not fit in a room, 0.5 m apart"):
        draw_room(crowded, np.random.default_rng(0))
    full = Scenario(name="full", boxes=(((-2.9, -1.0, -2.9), (2.9, 1.0, 2.9)),), start=CORNER)
    with pytest.raises(RuntimeError, match="'full': no room was found"):
        draw_room(full, np.random.default_rng(0))


def test_where_clusters_fall_into_a_box_another_room_is_drawn() -> None:
    """A reset raised NoRoomError, and ended a training, though the next room would have done."""
    core = ((-2.0, -1.2, -2.0), (2.0, 1.2, 2.0))
    one = {"landmark_layout": CLUSTERS, "cluster_count": 1, "cluster_std": 0.1}
    scenario = Scenario(room_size=(8.0, 2.4, 8.0), start=WALL, boxes=(core,), **one)
    for seed in range(30):
        room = draw_room(scenario, np.random.default_rng(seed))
        assert not inside_any(room.landmarks, room.boxes).any()


@pytest.mark.parametrize("limit", [{"maximum_distance": 1.5}, {"minimum_depth": 1.5}, {"principal_x_px": 0.0}])
def test_fiducials_are_within_the_limits_of_the_sensor(limit: dict[str, float]) -> None:
    scenario, z = Scenario(**limit), np.empty(2)
    for seed in range(20):
        room = draw_room(scenario, np.random.default_rng(seed))
        view = View(camera_of(scenario), room.camera, rotation_matrix(room.camera[3:7]), room.boxes)
        assert all(visible(view, point, 0.0, z) for point in room.fiducials)


@pytest.mark.parametrize("start", [CENTRE, WALL, ANYWHERE])
def test_a_first_pose_is_within_the_walls_however_uncertain(start: str) -> None:
    scenario = Scenario(start=start, position_std=(0.5, 0.5, 0.5))
    cameras = np.array([draw_room(scenario, np.random.default_rng(seed)).camera for seed in range(100)])
    assert (np.abs(cameras[:, :3]) <= 0.5 * np.array(scenario.room_size) - scenario.wall_margin).all()


def test_starts_are_where_they_should_be() -> None:
    corners, headings = set(), set()
    for seed in range(60):
        room = draw_room(Scenario(start=CORNER), np.random.default_rng(seed))
        forward = rotation_matrix(room.place[3:])[:, 2]
        assert np.abs(room.place[[0, 2]]) == pytest.approx([1.6, 1.6]) and forward[1] == pytest.approx(0.0)
        assert (room.place[:3] @ forward) == pytest.approx(1.6), "it faces a wall of the corner"
        corners.add(tuple(np.sign(room.place[[0, 2]])))
        headings.add(tuple(np.round(forward)))
    assert len(corners) == len(headings) == 4
    places = np.array([draw_room(Scenario(start=ANYWHERE), np.random.default_rng(s)).place for s in range(40)])
    assert (places[:, [0, 2]].std(axis=0) > 0.8).all() and np.ptp(places[:, 3]) > 0.5


def test_no_way_leads_into_a_box() -> None:
    """Cameras that are pushed about at random never end up inside, and never leave the room."""
    scenario, room = drawn("office", 3)
    wild = replace(scenario, acceleration_std=30.0, angular_acceleration_std=1.0)
    motion, world = motion_of(wild, 1.0), row(simulator.empty_worlds(scenario, 1, scenario.box_capacity), 0)
    simulator.put_room(world, room)
    touched = 0
    for frame in range(1500):
        world.state.frame = frame
        touched += simulator.move(motion, world, np.zeros(6))
        world.state.camera[7:10] *= 0.7
        p = world.state.camera[None, :3]
        assert not inside_any(p, room.boxes, scenario.wall_margin - 1e-9).any()
        assert (np.abs(p) <= motion.half - scenario.wall_margin + 1e-12).all()
    assert touched > 20


@pytest.mark.parametrize("seed", range(5))
def test_a_free_way_ends_where_a_walk_along_it_enters_a_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, margin = np.sort(rng.uniform(-2.0, 2.0, (3, 2, 3)), axis=1), 0.1
    for _ in range(60):
        p, way = rng.uniform(-3.0, 3.0, 3), rng.uniform(-3.0, 3.0, 3)
        if inside_any(p[None], boxes, margin)[0]:
            continue
        walk = p + np.linspace(0.0, 1.0, 20001)[:, None] * way
        entered = np.flatnonzero(inside_any(walk, boxes, margin))
        expected = entered[0] / 20000 if len(entered) else 1.0
        assert free_way(boxes, margin, p, way) == pytest.approx(expected, abs=2e-4)
    assert free_way(BOX, 0.1, np.array([0.95, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])) == 0.0
    assert free_way(BOX, 0.1, np.array([0.95, 0.0, 0.0]), np.array([-1.0, 0.2, 0.0])) == 1.0


def test_a_surface_is_seen_from_its_front_alone_and_not_too_aslant() -> None:
    y, normal = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, -1.0])
    for degrees, seen in ((0.0, True), (60.0, True), (74.0, True), (76.0, False), (120.0, False)):
        angle = np.radians(degrees)
        p = y - 2.0 * np.array([np.sin(angle), 0.0, np.cos(angle)])
        assert simulator.faces(normal, y, p, np.cos(np.radians(75.0))) == seen


def started(**fields):
    box = ((-1.0, -1.0, 1.0), (1.0, 1.0, 1.5))
    scenario = {"boxes": (box,), "fiducial_distance": (0.4, 0.9), **fields}
    env = gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25, motion_period=1.0)
    env.reset(seed=2)
    return env


def test_what_is_too_far_is_not_detected_and_its_absence_tells_nothing() -> None:
    near_by = {"fiducial_distance": (0.8, 1.2)}  # both draw the same room: all fiducials are within 2 m
    scenarios = ({"maximum_distance": most, **near_by} for most in (2.0, None))
    near, far = (gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25) for scenario in scenarios)
    for env in (near, far):
        env.reset(seed=4)
        env.step((Motion.STAY, 2))
    seen, all_seen = near.unwrapped.labels.detected, far.unwrapped.labels.detected
    points = np.concatenate((near.unwrapped.truth.fiducials, near.unwrapped.truth.landmarks))
    distance = np.linalg.norm(points - near.unwrapped.truth.position, axis=1)
    assert set(seen) == {k for k in all_seen if distance[k] <= 2.0} and len(seen) < len(all_seen)


def test_clearance_is_observed_where_there_are_boxes_and_nowhere_else() -> None:
    env = started(start="centre")
    layout, core = activeslam_gym.observation_layout(env), env.unwrapped
    observation = core._runs.observation[0]
    told = 3.0 * observation[layout.global_slices["clearance"]]
    x, y, z = core.truth.position
    assert told[Motion.FORWARD] == pytest.approx(1.0 - 0.1 - z, abs=0.02)
    assert told[Motion.UP] == pytest.approx(0.9 - y, abs=0.03) and told[Motion.STAY] == min(told[:-1])
    assert told[Motion.LEFT] == pytest.approx(2.9 - x, abs=0.1)
    plain = activeslam_gym.observation_layout(gym.make("ActiveSLAM-v0"))
    assert "clearance" not in plain.global_slices and layout.size == plain.size + 7
    assert layout.tokens.start == 39 and layout.tokens.stop == layout.size


def test_a_goal_ends_short_of_a_box_and_the_planner_knows_it() -> None:
    """Whether the belief knows the boxes or not: the range finder does."""
    for known in (False, True):
        env = started(boxes_known=known, acceleration_std=0.01, angular_acceleration_std=0.01)
        core = env.unwrapped
        for _ in range(16):
            _, _, _, _, info = env.step((Motion.FORWARD, 2))
        assert info["events"]["wall_contacts"] == 0
        assert core.truth.position[2] == pytest.approx(0.6, abs=0.12), "0.4 m before the box"
        scores = core.motion_scores()
        assert scores[Motion.FORWARD] == pytest.approx(scores[Motion.STAY], abs=2.0)


def random_scenario(rng: np.random.Generator) -> Scenario:
    """A legal scenario whose room has space: starts, layouts, boxes, walls and varied fields at random."""
    layout = str(rng.choice(("uniform", "clusters", SURFACES)))
    least = (float(rng.uniform(6.0, 9.0)), float(rng.uniform(2.0, 3.0)), float(rng.uniform(6.0, 9.0)))
    greatest = tuple(side + float(rng.uniform(0.0, 3.0)) for side in least)
    ranges = np.sort(rng.uniform(0.3, 1.2, (2, 2)), axis=0).tolist()  # the second is greater at both ends
    fields: list[tuple[str, Any, Any]] = [
        ("room_size", least, greatest),
        ("pixel_std", *np.sort(rng.uniform(0.5, 3.0, 2)).tolist()),
        ("missed_detection_probability", 0.0, float(rng.uniform(0.0, 0.3))),
        ("box_width", *(tuple(sorted(one)) for one in ranges)),
    ]
    return replace(
        SCENARIOS["office" if layout == SURFACES else "paper"],
        landmark_layout=layout,
        start=ANYWHERE if layout == SURFACES else str(rng.choice((CENTRE, CORNER, WALL, ANYWHERE))),
        room_size=least,
        landmark_count=int(rng.integers(1, 80)),
        fiducial_count=int(rng.integers(0, 12)),
        box_count=(0, int(rng.integers(0, 5))),
        inner_walls=(0, int(rng.integers(0, 3)) if layout == SURFACES else 0),
        door_width=PASSAGE + float(rng.uniform(0.0, 1.0)),
        boxes_known=bool(rng.random() < 0.5),
        varied=tuple(one for one in fields if rng.random() < 0.6),
    )


@pytest.mark.parametrize("seed", range(12))
def test_a_random_legal_scenario_has_a_room_at_each_of_40_resets(seed: int) -> None:
    scenario = random_scenario(np.random.default_rng(seed))
    for reset in range(40):
        rng = np.random.default_rng(reset)
        drawn = varied(scenario, rng)
        room = draw_room(drawn, rng)
        assert room.fiducials.shape == (scenario.fiducial_count, 3)
        assert room.landmarks.shape == (scenario.landmark_count, 3)
        assert len(room.boxes) <= scenario.box_capacity
        expected = expected_points(drawn, room, rng)
        assert not (scenario.boxes_known and inside_any(expected, room.boxes).any())
