"""A scenario's fields: each within its bounds, and plain enough for JSON whatever it was given as."""

import itertools
import json
import re
from dataclasses import asdict, replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym.config import BOUNDS, SCENARIOS, VARIABLE, Scenario, scenario_from, whole_multiple

PAPER = asdict(Scenario())
VARIED = f"triples (field, least, greatest), of the fields {', '.join(VARIABLE)}"

BOX = ((0.0, -1.0, 0.5), (1.0, 1.0, 0.75))
LOW, HIGH = BOX
NO_BOXES = (None, 0, BOX, (LOW,), ((LOW, (1.0, 1.0)),), ((LOW, LOW),), ((HIGH, LOW),), (BOX, "box"))
NO_BOXES += (((LOW, (1.0, 1.0, float("inf"))),), ((LOW, (1.0, True, 1.0)),), ((LOW, HIGH, HIGH),))


def refusal(name: str, value: Any) -> str:
    """What is said of a value of a field."""
    with pytest.raises(ValueError) as error:
        Scenario(**{name: value})
    return str(error.value)


def test_every_field_has_a_bound_and_says_it_of_a_number_beyond_any_float_too() -> None:
    for name, value in itertools.product(PAPER, (object(), [object()], {})):
        plain = tuple(value) if isinstance(value, list) else value
        assert refusal(name, value) == f"scenario.{name} must be {BOUNDS[name][0].allowed}, got {plain!r}"
    for name in set(PAPER) - {"name", "initialisation", "motion_criterion"}:
        assert re.match(rf"scenario\.{name} must be .*, got 10000", refusal(name, 10**400))
    with pytest.raises(ValueError, match="duration must be a positive number of seconds, got 10000"):
        whole_multiple("duration", 10**400, "gaze_period", 0.05)
    with pytest.raises(ValueError, match="duration must be at most 1000000000 times gaze_period"):
        whole_multiple("duration", 1e308, "gaze_period", 0.05)


OUT_OF_BOUNDS: tuple[tuple[str, str, tuple[Any, ...]], ...] = (
    ("pixel_std", "a positive number", (0.0, -1.0, float("nan"), float("inf"), True, "2", None)),
    ("landmark_count", "a whole number", (2.5, 27.0, True, np.float64(27.0))),
    ("filter_acceleration_std", "a positive number or None", (0.0, -1.0, False)),
    ("boxes", "boxes ((x, y, z), (x, y, z)), the lowest and the highest corner of each", NO_BOXES),
    ("box_count", "two whole numbers from 0 to 100, in no decreasing order", ((3, 2), (0, 1.5), (-1, 1), 3, (1,))),
    ("varied", VARIED, ((("duration", 1, 2),), 3, ((np.ones(3), 1, 2),))),
    ("varied", "triples of different fields", ((("pixel_std", 1.0, 2.0), ("pixel_std", 3.0, 4.0)),)),
    ("start", "one of centre, corner, wall, anywhere", ("middle", 3)),
    ("boxes_known", "True or False", (0, 1, None, "no")),
    ("room_size", "3 positive numbers", (6.0, (6.0, 2.0), (6.0, 2.0, 0.0), [6.0, 2.0, "6"], np.ones(2))),
    ("particle_depth", "in increasing order", ((9.0, 0.3), (1.0, 1.0))),
    ("goal_margin", "less than half of the smallest side", (1.0, 5.0)),
    ("wall_margin", "at most goal_margin", (0.5,)),
    ("point_spacing", "at most 1.03: its points must fit", (1.1, 5)),
    ("rate_loop_time", "over 0.025 s, half of frame_time, to be stable", (0.001,)),
    ("controller_frequency", "under 16.6 rad/s, 0.83 / frame_time: a faster controller is unstable", (50,)),
    ("principal_x_px", "of a size from 1e-12 to 1e12", (1e300, 1e-300)),
)


def test_what_is_out_of_bounds_is_named() -> None:
    for name, allowed, values in OUT_OF_BOUNDS:
        for value in values:
            assert refusal(name, value).startswith(f"scenario.{name} must be {allowed}, got "), (name, value)
    assert refusal("start", "Corner").endswith("got 'Corner' (did you mean 'corner'?)")
    assert len(refusal("boxes", np.zeros((100, 100)))) < 500


def as_numpy(value: Any) -> Any:
    if isinstance(value, tuple):
        return [as_numpy(part) for part in value]
    return value if value is None else np.array(value)[()]


def types_of(value: Any) -> Any:
    return [type(value), *map(types_of, value)] if isinstance(value, tuple) else type(value)


def test_json_and_numpy_hand_back_the_same_scenario() -> None:
    for scenario in (*SCENARIOS.values(), Scenario(name="boxes", boxes=(BOX, BOX))):
        fields = asdict(scenario)
        assert scenario_from(json.loads(json.dumps(fields))) == scenario
        given = scenario_from({name: as_numpy(value) for name, value in fields.items()})
        arrays = {
            name: np.array(value) for name, value in fields.items() if name in ("room_size", "boxes", "box_count")
        }
        assert scenario_from({**fields, **arrays}) == given == scenario
        assert types_of(tuple(asdict(given).values())) == types_of(tuple(fields.values()))


def test_absent_fields_of_a_dict_are_those_of_the_scenario_of_its_name() -> None:
    """They were the ones of `paper`, under a header that said office."""
    assert scenario_from({"name": "office", "pixel_std": 2.0}) == replace(SCENARIOS["office"], pixel_std=2.0)
    for fields in ({"pixel_std": 2.0}, {"name": "own", "pixel_std": 2.0}):
        assert scenario_from(fields) == Scenario(**{"name": "custom", **fields})


STEPS: tuple[tuple[Any, dict[str, float], float], ...] = (
    ("hand-held", {}, 0.2),
    ("paper-literal", {}, 0.05),
    ({"frame_time": 1 / 29}, {}, 1 / 29),
    ({"gaze_period": 0.12}, {}, 0.1),
    ("paper", {"motion_period": 0.15}, 0.05),
    ("paper", {"duration": 3.4}, 0.2),
)
"""Scenario, arguments of the environment, and the step that follows [s]."""


@pytest.mark.parametrize(("scenario", "times", "gaze_period"), STEPS)
def test_a_step_is_the_longest_within_the_scenarios_that_divides_motion_and_episode(
    scenario: Any, times: dict[str, float], gaze_period: float
) -> None:
    env = gym.make("ActiveSLAM-v0", scenario=scenario, **times).unwrapped
    assert env.gaze_period == pytest.approx(gaze_period)
    for whole in (env.motion_period / env.gaze_period, env.duration / env.gaze_period):
        assert whole == pytest.approx(round(whole), abs=1e-6)
