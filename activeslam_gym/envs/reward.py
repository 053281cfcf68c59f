"""Rewards: each the gain of a named potential, so that they sum to its gain over the episode.

A potential is a function of an EVALUATION record. Those of this module are compiled into the kernel of a step. Any
other such function is called from Python: ``gymnasium.make("ActiveSLAM-v0", reward=function)``. Everything else is the
same: the gain of a step, the failure penalty, `info["reward_terms"]`.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

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
    position_nees="f8",  # of the camera, per degree of freedom
)
"""What a belief is worth at one moment."""

Potential = Callable[[Record], float]
LOST_PENALTY = "lost_penalty"  # name of the failure penalty in `info["reward_terms"]`


@compiled
def entropy(e: Record) -> float:
    """-H, H = 1/2 log2((2 pi e)^(12 + 3 N) |P_counted| |Sigma_prior|^(N - m)) [bit]."""
    return -e.entropy


@compiled
def log_score(e: Record) -> float:
    """log2 N(truth | belief) over camera and true landmarks [bit]: a proper score; its gains sum to the log score."""
    return e.log_density


@compiled
def pose_entropy(e: Record) -> float:
    """-H of the camera's position and rotation (6 dimensions) [bit]."""
    return -0.5 * (6 * LOG2_2PIE + e.log2_det_pose)


@compiled
def map_entropy(e: Record) -> float:
    """-H of the map (3 N dimensions) [bit]."""
    return -0.5 * (3 * e.landmarks * LOG2_2PIE + e.log2_det_map)


@compiled
def d_optimality(e: Record) -> float:
    """-|P|^(1/n), n = 12 + 3 N."""
    return -(2.0 ** (e.log2_det_total / (CAMERA_DIM + 3 * e.landmarks)))


@compiled
def a_optimality(e: Record) -> float:
    """-tr P over the positions of camera and map [m^2]."""
    return -e.position_trace


@compiled
def variance_reduction(e: Record) -> float:
    """-tr P over everything (mixed units)."""
    return -e.trace


_OWN = (entropy, log_score, pose_entropy, map_entropy, d_optimality, a_optimality, variance_reduction)
REWARDS: Mapping[str, Potential] = MappingProxyType({one.__name__: one for one in _OWN})
"""The potentials by name."""
potential_of_number = one_of(_OWN)
"""For kernels: of (number, e), the potential of that number (see `registry.number_of`)."""
