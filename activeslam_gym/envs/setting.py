"""From the arguments of an environment to the constants of its runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium

from activeslam_gym.camera import camera_of
from activeslam_gym.config import (
    BOUNDS,
    CENTRE,
    CLUSTERS,
    CORNER,
    IMAGE_SCENARIOS,
    KNOWN,
    MOST_HELD_FRAMES,
    UNIFORM,
    WALL,
    Scenario,
    did_you_mean,
    plain,
    positive_number,
    scenario_from,
    whole_multiple,
    whole_number,
)
from activeslam_gym.envs.observation import ObservationLayout, layout_of
from activeslam_gym.envs.reward import REWARDS, Potential
from activeslam_gym.envs.run import MODELS, TASK
from activeslam_gym.information.candidates import UNLIMITED, SensorLimits
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.kernels import Record, filled
from activeslam_gym.metrics import LOST_POSITION_ERROR
from activeslam_gym.motion import LARGEST_ACCELERATION, motion_of
from activeslam_gym.registry import name_of, number_of, part_of
from activeslam_gym.sensors.sensor import IMAGES, OWN_SENSORS, POINTS, TEXTURED
from activeslam_gym.slam.ekf import ESTIMATORS
from activeslam_gym.slam.filter import filter_of
from activeslam_gym.world.room import scene_factory
from activeslam_gym.world.simulator import sensor_of

_NO_FIELDS = (
    *("motion_period", "reward", "criterion", "lost_position_error", "end_when_lost", "render_mode", "render_size"),
    "scenario",
)
"""Arguments of an environment that no scenario has as a field."""
_PARTS = {"scene": "scene", "sensor": "sensor", "estimator": "estimator", "criterion": "motion_criterion"}
"""Arguments that take the place of a field of the scenario."""
_MINIMUM_JERK_PEAK = 10.0 / math.sqrt(3.0)
"""Greatest acceleration of a minimum-jerk translation, in lengths over its squared time."""
PICTURE_SIDE = (64, 8192)  # the least and the most pixels of a picture's side


@dataclass(frozen=True)
class Setting:
    """Resolved arguments of an environment; times in seconds."""

    scenario: Scenario
    gaze_period: float
    motion_period: float
    duration: float
    reward: str
    """Its name."""
    potential: Potential
    """The function of it."""
    models: Record
    """MODELS."""
    layout: ObservationLayout

    @property
    def task(self) -> Record:
        """TASK."""
        return self.models.task

    @property
    def render_rate(self) -> int:
        """Frames a second at which a video of one picture a step shows true time."""
        return max(1, round(1.0 / self.gaze_period))


def scenario_with(scenario: str | Mapping[str, Any] | Scenario, **parts: Any) -> Scenario:
    """The scenario with those of the ``parts`` that are given, names or objects, and with the room of its scene."""
    given = replace(scenario_from(scenario), **{name: part for name, part in parts.items() if part is not None})
    fitted = getattr(scene_factory(given.scene), "fitted", None)
    return fitted(given) if fitted else given


def resolve(
    scenario: str | Mapping[str, Any] | Scenario = "paper",
    gaze_period: float | None = None,
    motion_period: float = 1.0,
    duration: float | None = None,
    reward: str | Potential = "entropy",
    lost_position_error: float = LOST_POSITION_ERROR,
    end_when_lost: bool = True,
    **others: Any,
) -> Setting:
    """Check the arguments of an environment and work out its constants; ``others``: ``scene``, ``sensor``,
    ``estimator`` and ``criterion``.

    Raises:
        TypeError: there is no such argument.
        ValueError: an argument is unknown, out of range, or no whole number of the period that it must be made of; the
            message names it, its value and what is allowed.
    """
    resolved = _checked(scenario, **others)
    frame, most = resolved.frame_time, MOST_HELD_FRAMES
    duration = resolved.duration if duration is None else duration
    if gaze_period is None:
        frames_per_step = _default_step(resolved, motion_period, duration)
    else:
        frames_per_step = whole_multiple("gaze_period", gaze_period, "the frame", frame, most)
    step_time = frames_per_step * frame
    steps_per_motion = whole_multiple("motion_period", motion_period, "gaze_period", step_time, most // frames_per_step)
    steps = whole_multiple("duration", duration, "gaze_period", step_time)
    least = math.sqrt(_MINIMUM_JERK_PEAK * resolved.step_length / LARGEST_ACCELERATION)
    if steps_per_motion * step_time < least:
        short = f"motion_period {motion_period:g} s is too short for a translation of {resolved.step_length:g} m"
        limit = f"with at most {LARGEST_ACCELERATION:g} m/s^2 it takes {least:.3g} s or more"
        gymnasium.logger.warn(f"{short}, which will end before its goal: {limit}")
    if not isinstance(end_when_lost := plain(end_when_lost), bool):
        raise ValueError(f"end_when_lost must be True or False, got {end_when_lost!r}")
    task = filled(
        TASK,
        frames_per_step=frames_per_step,
        steps_per_motion=steps_per_motion,
        steps=steps,
        reward=number_of("reward", reward, REWARDS),
        lost_position_error=positive_number("lost_position_error", lost_position_error, "metres"),
        end_when_lost=end_when_lost,
        labelled_first_match=resolved.labelled_first_match,
        association_known=resolved.association == KNOWN,
    )
    return Setting(
        scenario=resolved,
        gaze_period=step_time,
        motion_period=steps_per_motion * step_time,
        duration=steps * step_time,
        reward=name_of(reward),
        potential=part_of("reward", reward, REWARDS),
        models=models_of(resolved, task, steps_per_motion * step_time),
        layout=layout_of(resolved),
    )


def _checked(scenario: str | Mapping[str, Any] | Scenario, **others: Any) -> Scenario:
    """The scenario with the parts among ``others``, which are all there and fit it."""
    parts = {_PARTS[name]: others.pop(name) for name in _PARTS if name in others}
    for name, value in others.items():
        field, near = (name, "") if name in BOUNDS else ("FIELD", did_you_mean(name, (*_NO_FIELDS, *BOUNDS)))
        # Python's words: TorchRL 0.14 tries an argument "frameskip", and reads in the error that there is none.
        message = f"got an unexpected keyword argument {name!r}{near}; a scenario's fields are given as "
        raise TypeError(f"{message}scenario={{{field!r}: {value!r}}}")
    resolved = scenario_with(scenario, **parts)
    if check := getattr(part_of("scenario.estimator", resolved.estimator, ESTIMATORS), "check", None):
        check(resolved)
    part_of("scenario.sensor", resolved.sensor, OWN_SENSORS)
    part_of("scenario.motion_criterion", resolved.motion_criterion, CRITERIA)
    if resolved.sensor in TEXTURED:
        require_textured(resolved)
    elif resolved.name in IMAGE_SCENARIOS and resolved.sensor == POINTS and parts.get("sensor") is None:
        pixels = f"gym.make('ActiveSLAMPixels-v0', scenario={resolved.name!r})"
        gymnasium.logger.warn(f"{resolved.name!r} is of images, but here it simulates points. Its images: {pixels}")
    return resolved


def _default_step(scenario: Scenario, motion_period: float, duration: float) -> int:
    """Most frames within the scenario's gaze period of which motion period and duration are whole numbers."""
    frame = scenario.frame_time
    motion_frames = whole_multiple("motion_period", motion_period, "the frame", frame, MOST_HELD_FRAMES)
    both = math.gcd(motion_frames, whole_multiple("duration", duration, "the frame", frame))
    most = max(1, int(scenario.gaze_period / frame + 1e-6))
    return max(frames for frames in range(1, min(most, both) + 1) if both % frames == 0)


def models_of(scenario: Scenario, task: Record, motion_period: float) -> Record:
    """The MODELS record of a scenario."""
    lens = camera_of(scenario)
    true_lens = lens.copy()
    if scenario.true_focal_px is not None:
        true_lens["focal"] = scenario.true_focal_px
    if scenario.true_distortion is not None:
        true_lens["distortion"] = scenario.true_distortion
    return filled(
        MODELS,
        lens=lens,
        true_lens=true_lens,
        motion=motion_of(scenario, motion_period),
        sensor=sensor_of(scenario),
        **sensor_limits(scenario)._asdict(),
        filter=filter_of(scenario),
        task=task,
        landmark_var=scenario.landmark_prior_variance,
        on_surfaces=scenario.on_surfaces,
        boxes_known=scenario.boxes_known,
        negative_information=scenario.negative_information,
    )


def sensor_limits(scenario: Scenario) -> SensorLimits:
    """The limits of the scenario's sensor."""
    if scenario.sensor in TEXTURED:
        from activeslam_gym.vision.settings import SIGHTED

        return SensorLimits(SIGHTED.most_change, SIGHTED.visible)
    return UNLIMITED


def checked_rendering(mode: Any, modes: Sequence[str], size: Any) -> tuple[str | None, tuple[int, int]]:
    """How pictures are asked for, None or one of the ``modes``, and their width and height [px].

    Raises:
        ValueError: it is no such mode, or the size is not two whole numbers in `PICTURE_SIDE`.
    """
    if mode is not None and not (isinstance(mode, str) and mode in modes):
        raise ValueError(f"render_mode must be None or {' or '.join(map(repr, modes))}, got {mode!r}")
    least, most = PICTURE_SIDE
    try:
        width, height = (whole_number("render_size", side, least) for side in size)
    except (TypeError, ValueError):
        width = height = 0
    if not 0 < max(width, height) <= most:
        raise ValueError(f"render_size must be (width, height) of {least} to {most} px, got {size!r}")
    return mode, (width, height)


def checked_images(sensor: Any) -> str:
    """The sensor of ``ActiveSLAMPixels-v0``. ValueError: another is given."""
    if sensor is not None and sensor != IMAGES:
        raise ValueError(f"sensor must be {IMAGES!r} in ActiveSLAMPixels-v0, got {sensor!r}")
    return IMAGES


_NOT_TEXTURED = (
    *("scene", "estimator", "initialisation", "association", "restarts", "maximum_misses", "miss_spacing"),
    *("inverse_depth_memory", "labelled_first_match", "boxes", "box_count", "inner_walls", "varied"),
    *("maximum_distance", "clutter_rate", "missed_detection_probability", "new_feature_gate_probability"),
    *("cluster_std", "facing_angle", "box_width", "box_height", "door_width"),
    *("particle_count", "particle_depth", "particle_prune", "particle_baseline"),
)
"""Fields that must keep their defaults in a textured room: its drawing and its front end do not read them."""


def require_textured(scenario: Scenario) -> None:
    """Raise where no textured room can be made of the scenario.

    Raises:
        ValueError: a field is not as `ActiveSLAMPixelsEnv` says.
        ModuleNotFoundError: OpenCV is not installed.
    """
    from activeslam_gym.vision.opencv import opencv
    from activeslam_gym.vision.room.camera import TARGET_CORNERS

    opencv()
    allowed_of: dict[str, tuple[Any, ...]] = {name: (getattr(Scenario(), name),) for name in _NOT_TEXTURED}
    layouts = {"start": (CENTRE, CORNER, WALL), "landmark_layout": (UNIFORM, CLUSTERS)}
    for name, allowed in {**allowed_of, **layouts, "fiducial_count": (TARGET_CORNERS,)}.items():
        if (value := getattr(scenario, name)) not in allowed:
            message = f"scenario.{name} must be {' or '.join(map(repr, allowed))} for {scenario.sensor}"
            raise ValueError(f"{message}, got {value!r}; scenarios of images: {', '.join(IMAGE_SCENARIOS)}")
