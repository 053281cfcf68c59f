"""Random legal scenarios reset without an error; scenarios without a usable room are refused with a reason."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from activeslam_gym import SCENARIOS, ActiveSLAMVectorEnv, Scenario
from activeslam_gym.config import ANYWHERE, CENTRE, CORNER, SURFACES, WALL
from activeslam_gym.world.furniture import PASSAGE
from activeslam_gym.world.room import draw_room, varied


def random_range(low: float, high: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Two legal values [(low, high), (low, high)] of a range field; the second is greater at both ends."""
    a, b, c, d = np.sort(rng.uniform(low, high, 4)).tolist()
    return [(a, b), (c, d)] if rng.random() < 0.5 else [(a, c), (b, d)]


# Scenarios that were accepted, and then hung or were lost -----------------------------------------------------------


@pytest.mark.parametrize("walls", [(1, 1), (0, 1)])
def test_a_door_wider_than_its_wall_is_refused(walls: tuple[int, int]) -> None:
    for width in (50, 5.3):
        with pytest.raises(ValueError, match=rf"scenario.door_width must be at most 5.2 m, .*, got {width}"):
            Scenario(inner_walls=walls, door_width=width)
    with pytest.raises(ValueError, match=r"scenario.door_width must be at most 2.2 m, .*, got 2.3"):
        Scenario(inner_walls=walls, door_width=2.3, varied=(("room_size", (3.0, 2.0, 4.0), (8.0, 2.0, 8.0)),))
    widest = Scenario(inner_walls=walls, door_width=5.2, start=ANYWHERE)
    assert len(draw_room(widest, np.random.default_rng(0)).boxes) <= 2


# Any legal scenario -------------------------------------------------------------------------------------------------


def random_scenario(rng: np.random.Generator) -> Scenario:
    """A legal scenario whose room has space: starts, layouts, boxes, walls and varied fields at random."""
    layout = str(rng.choice(("uniform", "clusters", SURFACES)))
    least = (float(rng.uniform(6.0, 9.0)), float(rng.uniform(2.0, 3.0)), float(rng.uniform(6.0, 9.0)))
    greatest = tuple(side + float(rng.uniform(0.0, 3.0)) for side in least)
    start = ANYWHERE if layout == SURFACES else str(rng.choice((CENTRE, CORNER, WALL, ANYWHERE)))
    fields: list[tuple[str, Any, Any]] = [
        ("room_size", least, greatest),
        ("pixel_std", *np.sort(rng.uniform(0.5, 3.0, 2)).tolist()),
        ("missed_detection_probability", 0.0, float(rng.uniform(0.0, 0.3))),
        ("acceleration_std", 0.0, float(rng.uniform(0.0, 0.5))),
        ("fiducial_distance", *random_range(1.0, 2.5, rng)),
        ("box_width", *random_range(0.3, 1.2, rng)),
        ("box_height", *random_range(0.3, 3.0, rng)),
    ]
    return replace(
        SCENARIOS["office" if layout == SURFACES else "paper"],
        landmark_layout=layout,
        start=start,
        room_size=least,
        landmark_count=int(rng.integers(1, 80)),
        fiducial_count=int(rng.integers(0, 12)),
        point_spacing=float(rng.choice((0.0, 0.1))),
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_a_random_legal_scenario_flies_and_every_number_is_finite(seed: int) -> None:
    env = ActiveSLAMVectorEnv(4, random_scenario(np.random.default_rng(seed)), duration=20.0, num_threads=1)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    for _ in range(200):
        observation, reward, *_, info = env.step(env.action_space.sample())
        numbers = [observation, reward, *info["reward_terms"].values(), *info["log2_det"].values()]
        numbers += [info[name] for name in ("entropy", "log_score", "position_error", "position_nees")]
        assert all(np.isfinite(value).all() for value in numbers)
