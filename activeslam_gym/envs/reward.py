"""Rewards: each the gain of a named potential, so that it telescopes to what was learned.

A potential is a function of an EVALUATION record. To add a reward, write its function here, with its name above it.
Everything else follows: the gain of a step, the forfeit of a lost run, `info["reward_terms"]`, the checks of arguments.
"""

from collections.abc import Callable
from typing import Any

from activeslam_gym.information.entropy import LOG2_2PIE
from activeslam_gym.kernels import Record, compiled, one_of, record
from activeslam_gym.motion import CAMERA_DIM

EVALUATION = record(
    landmarks="i8",  # N
    entropy="f8",  # of camera and N landmarks [bit]
    log2_det_camera="f8",
    log2_det_pose="f8",
    log2_det_map="f8",
    log2_det_total="f8",
    log_density="f8",  # log2 N(truth | belief) over camera and true landmarks [bit]
    position_trace="f8",  # tr P over the positions of camera and map [m^2]
    trace="f8",  # tr P over everything (mixed units)
    log_score="f8",  # log_density, less that of the reset [bit]
    landmarks_mapped="i8",
    distinct_landmarks="i8",  # true landmarks that a mapped feature stands for
    position_error="f8",  # of the camera [m]
    orientation_error="f8",  # of the camera [rad]
    landmark_rmse="f8",  # over the distinct landmarks [m]; inf until there is one
    position_nees="f8",  # 3 degrees of freedom
)
"""What a belief is worth at one moment."""

Potential = Callable[[Record], float]
REWARDS: dict[str, Potential] = {}
"""The potentials by name."""


def named(name: str) -> Callable[[Any], Any]:
    """Decorator that enters a potential into `REWARDS`."""

    def enter(potential: Any) -> Any:
        REWARDS[name] = compiled(potential)
        return REWARDS[name]

    return enter


@named("entropy")
def entropy(e: Record) -> float:
    """-H, H = 1/2 log2((2 pi e)^(12 + 3 N) |P_counted| |Sigma_prior|^(N - m)) [bit]."""
    return -e.entropy


@named("log_score")
def log_score(e: Record) -> float:
    """log2 N(truth | belief) over camera and true landmarks [bit]: a proper score."""
    return e.log_density


@named("pose_entropy")
def pose_entropy(e: Record) -> float:
    """-H of the camera's position and rotation (6 dimensions) [bit]."""
    return -0.5 * (6 * LOG2_2PIE + e.log2_det_pose)


@named("map_entropy")
def map_entropy(e: Record) -> float:
    """-H of the map (3 N dimensions) [bit]."""
    return -0.5 * (3 * e.landmarks * LOG2_2PIE + e.log2_det_map)


@named("d_optimality")
def d_optimality(e: Record) -> float:
    """-|P|^(1/n), n = 12 + 3 N."""
    return -(2.0 ** (e.log2_det_total / (CAMERA_DIM + 3 * e.landmarks)))


@named("a_optimality")
def a_optimality(e: Record) -> float:
    """-tr P over the positions of camera and map [m^2]."""
    return -e.position_trace


@named("variance_reduction")
def variance_reduction(e: Record) -> float:
    """-tr P over everything (mixed units)."""
    return -e.trace


potential_of_number = one_of(list(REWARDS.values()))
"""For kernels: of (number, e), the potential of that number (see `reward_number`)."""


def reward_number(reward: str) -> int:
    """Where a reward stands in `REWARDS`.

    Raises:
        ValueError: there is no such reward; the message lists those that there are.
    """
    if not isinstance(reward, str) or reward not in REWARDS:
        raise ValueError(f"reward must be one of {', '.join(REWARDS)}, got {reward!r}")
    return list(REWARDS).index(reward)
