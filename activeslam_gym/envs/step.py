"""One step of an environment: some frames, then what they are worth and what is seen of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from activeslam_gym.config import Scenario
from activeslam_gym.envs.frame import Models, Simulation, advance, begin_motion, empty_simulation, reset_simulation
from activeslam_gym.envs.observation import GLOBAL_SIZE, TOKEN_SIZE, clip_into, layout_of, observe_globals, observe_tokens
from activeslam_gym.envs.reward import REWARDS, potentials
from activeslam_gym.envs.scoring import features_of_landmarks, find_mapped, landmark_errors, log2_density
from activeslam_gym.information import (
    CAMERA,
    MAP,
    TOTAL,
    LOG2_2PIE,
    counting_features,
    gathered,
    log2_dets,
    update_expectation,
    variance_sums,
)
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION
from activeslam_gym.slam.belief import FEATURES, point_belief

VALUES = (
    "entropy",
    "log2_det_camera",
    "log2_det_map",
    "log2_det_total",
    "log_score",
    "landmarks_mapped",
    "distinct_landmarks",
    "position_error",
    "orientation_error",
    "landmark_rmse",
    "position_nees",
)
"""Names of `Step.values`."""
(ENTROPY, LOG2_CAMERA, LOG2_MAP, LOG2_TOTAL, LOG_SCORE, MAPPED, DISTINCT, POSITION_ERROR, ORIENTATION_ERROR, RMSE, NEES) = (
    range(len(VALUES))
)
FORFEIT = len(REWARDS)
"""Entry of `Step.terms` behind those of the rewards."""
STEPS, LOST = 0, 1
"""Entries of `Step.status`."""
GAIN, RETURN, DENSITY_0, REWARD = 0, 1, 2, 3
"""Entries of `Step.sums`."""


class Task(NamedTuple):
    """What an environment asks: its rhythm, its reward, and when a run is lost."""

    frames_per_step: int
    steps_per_motion: int
    steps: int
    reward: int
    lost_position_error: float
    mapped_depth_ratio: float
    labelled_first_match: bool


class Step(NamedTuple):
    """What one run has been worth so far. D observed numbers."""

    values: np.ndarray
    """(11,) the numbers of VALUES after the last step."""
    potential: np.ndarray
    """(7,) potentials after the last step, in the order of REWARDS."""
    terms: np.ndarray
    """(8,) gain of each potential in the last step, and the forfeit."""
    sums: np.ndarray
    """(4,) entropy removed so far; return so far; log density of the truth at the reset; reward of the last step."""
    status: np.ndarray
    """(2,) steps so far; 1 once lost."""
    observation: np.ndarray
    """(D,) float32."""


class Run(NamedTuple):
    """A run: the simulation and its worth."""

    simulation: Simulation
    step: Step


def empty_run(scenario: Scenario) -> Run:
    """Arrays of the scenario's capacity; `reset_run` fills them."""
    size = layout_of(scenario).size
    step = Step(
        values=np.zeros(len(VALUES)),
        potential=np.zeros(len(REWARDS)),
        terms=np.zeros(len(REWARDS) + 1),
        sums=np.zeros(4),
        status=np.zeros(2, np.int64),
        observation=np.zeros(size, np.float32),
    )
    return Run(empty_simulation(scenario), step)


def reset_run(models: Models, task: Task, scenario: Scenario, run: Run, key: int) -> None:
    """Begin a new run from ``key``, a non-negative integer."""
    reset_simulation(run.simulation, scenario, key)
    for array in run.step:
        array[...] = 0
    begin_run(models, task, run)


@njit(cache=True)
def begin_run(models: Models, task: Task, run: Run) -> None:
    """Evaluate a run that has just been given its prior."""
    begin_motion(models.motion, run.simulation.belief, run.simulation.control, 6)  # STAY, until a motion is read
    run.step.values[LOG_SCORE] = 0.0
    evaluate(models, task, run)
    run.step.sums[DENSITY_0] = run.step.potential[1]
    run.step.values[LOG_SCORE] = 0.0
    run.step.terms[:] = 0.0
    run.step.sums[GAIN] = 0.0
    observe(models, task, run)


@njit(cache=True)
def step_run(models: Models, task: Task, run: Run, motion: int, gaze: int) -> None:
    """One gaze period under an action, all of it: frames, values, reward, observation."""
    simulation, step = run.simulation, run.step
    if step.status[STEPS] % task.steps_per_motion == 0:
        begin_motion(models.motion, simulation.belief, simulation.control, motion)
    simulation.events[:] = 0
    for _ in range(task.frames_per_step):
        advance(models, simulation, gaze, task.labelled_first_match)
    step.status[STEPS] += 1
    evaluate(models, task, run)
    _settle(task, step)
    observe(models, task, run)


@njit(cache=True)
def _settle(task: Task, step: Step) -> None:
    """The reward of the step: the gain of the chosen potential, and if lost the forfeit of all that was gained."""
    reward = step.terms[task.reward]
    step.sums[RETURN] += reward
    step.terms[FORFEIT] = 0.0
    if step.status[LOST] == 1:
        step.terms[FORFEIT] = -max(0.0, step.sums[RETURN])
        step.sums[RETURN] += step.terms[FORFEIT]
    step.sums[REWARD] = reward + step.terms[FORFEIT]
    step.sums[GAIN] += step.terms[0]


@njit(cache=True)
def evaluate(models: Models, task: Task, run: Run) -> None:
    """Bring the public belief, the expected landmarks, the values and the potentials up to date.

    Where the public covariance is not positive definite the run is lost, and values and potentials stay as they were.
    """
    simulation, step = run.simulation, run.step
    world, belief, expectation = simulation.world, simulation.belief, simulation.expectation
    points, P = simulation.points, simulation.covariance
    N = expectation.points.shape[0]
    K = world.points.shape[0] - N
    n = point_belief(belief, points, P)
    update_expectation(expectation, belief, points, P)
    first, second, rest, of_landmark = _ordered_features(simulation, n, N)
    U = gathered(P, first, np.concatenate((second, rest)))
    sound = cholesky_in_place(U)
    find_mapped(belief, task.mapped_depth_ratio, simulation.mapped)
    _evaluate_errors(run, n, N, K)
    step.status[LOST] = not sound or step.values[POSITION_ERROR] > task.lost_position_error
    step.terms[:] = 0.0
    if not sound:
        return
    dets = log2_dets(expectation, P, U, first, second)
    density = log2_density(world, belief, expectation, points, of_landmark, U, K)
    positions, everything = variance_sums(expectation, P, np.concatenate((first, second)))
    new = potentials(dets, density, positions, everything, N)
    step.terms[:FORFEIT] = new - step.potential
    step.potential[:] = new
    step.values[ENTROPY] = 0.5 * ((CAMERA_DIM + 3 * N) * LOG2_2PIE + dets[TOTAL])
    step.values[LOG2_CAMERA], step.values[LOG2_MAP], step.values[LOG2_TOTAL] = dets[CAMERA], dets[MAP], dets[TOTAL]
    step.values[LOG_SCORE] = density - step.sums[DENSITY_0]


@njit(cache=True)
def _ordered_features(
    simulation: Simulation, n: int, N: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Features by position k: those that count and stand for a landmark, the others that count, the rest; (L,) k."""
    counting = counting_features(simulation.expectation, simulation.belief)
    eligible = np.zeros(n, np.bool_)
    eligible[counting] = True
    of_landmark = features_of_landmarks(simulation.labels, simulation.belief, N, eligible)
    first = of_landmark[of_landmark >= 0]
    standing = np.zeros(n, np.bool_)
    standing[first] = True
    return first, np.where(eligible & ~standing)[0], np.where(~eligible)[0], of_landmark


@njit(cache=True)
def _evaluate_errors(run: Run, n: int, N: int, K: int) -> None:
    """Errors against the truth, and counts of what is mapped."""
    simulation, values = run.simulation, run.step.values
    error = camera_error(simulation.world.camera, simulation.belief.camera)
    values[POSITION_ERROR] = np.sqrt(np.sum(error[D_POSITION] ** 2))
    values[ORIENTATION_ERROR] = np.sqrt(np.sum(error[D_ROTATION] ** 2))
    values[NEES] = nees(error[D_POSITION], simulation.covariance[D_POSITION, D_POSITION])
    mapped = simulation.mapped[:n]
    of_landmark = features_of_landmarks(simulation.labels, simulation.belief, N, mapped)
    distances = landmark_errors(simulation.world, simulation.points, of_landmark, K)
    values[MAPPED] = np.sum(mapped)
    values[DISTINCT] = np.sum(of_landmark >= 0)
    squares = distances[of_landmark >= 0] ** 2
    values[RMSE] = np.sqrt(np.mean(squares)) if squares.shape[0] > 0 else np.inf


@njit(cache=True)
def observe(models: Models, task: Task, run: Run) -> None:
    """Write the observation; it reads the belief and the task's rhythm only."""
    simulation, step = run.simulation, run.step
    belief, expectation = simulation.belief, simulation.expectation
    N = expectation.points.shape[0]
    K = simulation.world.points.shape[0] - N
    mapped = simulation.mapped[: belief.size[FEATURES]]
    flat = np.empty(step.observation.shape[0])
    phase = (step.status[STEPS] % task.steps_per_motion) / task.steps_per_motion
    observe_globals(
        models.motion,
        belief,
        step.status[STEPS] / task.steps,
        phase,
        simulation.control.command[0],
        int(np.sum(mapped)),
        int(np.sum(expectation.slot >= 0)),
        N,
        step.sums[GAIN],
        flat[:GLOBAL_SIZE],
    )
    observe_tokens(
        models.camera,
        belief,
        simulation.points,
        simulation.covariance,
        expectation,
        simulation.world.points[:K],
        mapped,
        flat[GLOBAL_SIZE:].reshape((-1, TOKEN_SIZE)),
    )
    clip_into(flat, step.observation)


