"""One step of an environment: some frames, then what they are worth and what is seen of them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.batching import batched, row
from activeslam_gym.compilation import SecondProcess, kernel, part
from activeslam_gym.config import Scenario
from activeslam_gym.envs.frame import (
    FilterEntries,
    Models,
    Simulation,
    advance,
    begin_motion,
    empty_simulation,
    filter_entries,
    reset_simulation,
)
from activeslam_gym.envs.observation import (
    GLOBAL_SIZE,
    TOKEN_SIZE,
    clip_into,
    layout_of,
    observe_globals,
    observe_tokens,
)
from activeslam_gym.envs.reward import REWARDS, potentials
from activeslam_gym.envs.scoring import Labels, features_of_landmarks, find_mapped, landmark_errors, log2_density
from activeslam_gym.information import (
    CAMERA,
    LOG2_2PIE,
    MAP,
    TOTAL,
    Expectation,
    find_counting,
    gathered,
    log2_dets,
    variance_sums,
    waiting_count,
)
from activeslam_gym.linalg import cholesky_in_place, count_true
from activeslam_gym.linking import enter, entry_of
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, Motion
from activeslam_gym.slam.belief import FEATURES, Belief, point_belief
from activeslam_gym.slam.filter import filter_frame
from activeslam_gym.world.simulator import World

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
(
    ENTROPY,
    LOG2_CAMERA,
    LOG2_MAP,
    LOG2_TOTAL,
    LOG_SCORE,
    MAPPED,
    DISTINCT,
    POSITION_ERROR,
    ORIENTATION_ERROR,
    RMSE,
    NEES,
) = range(len(VALUES))
FORFEIT = len(REWARDS)
"""Entry of `Step.terms` behind those of the rewards."""
ENTROPY_POTENTIAL, DENSITY = REWARDS.index("entropy"), REWARDS.index("log_score")
STAY = int(Motion.STAY)
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


def empty_runs(scenario: Scenario, count: int) -> Run:
    """``count`` runs of the scenario's capacity: arrays with a leading axis. `reset_run` fills a row of them."""
    step = Step(
        values=np.zeros(len(VALUES)),
        potential=np.zeros(len(REWARDS)),
        terms=np.zeros(len(REWARDS) + 1),
        sums=np.zeros(4),
        status=np.zeros(2, np.int64),
        observation=np.zeros(layout_of(scenario).size, np.float32),
    )
    return batched(Run(empty_simulation(scenario), step), count)


def reset_run(scenario: Scenario, run: Run, key: int) -> None:
    """Give a run its room and its prior from ``key``, a non-negative integer. `play` with BEGIN evaluates it."""
    reset_simulation(run.simulation, scenario, key)
    for array in run.step:
        array[...] = 0


BEGIN, REST = -1, -2
"""In place of a motion: evaluate a run that has just been reset; leave it alone."""


class Entries(NamedTuple):
    """How the two halves of a step are entered, and the filter; see `linking`."""

    advance_runs: Any
    evaluate_runs: Any
    filter: FilterEntries


def entries_of(
    models: Models, task: Task, runs: Run, motions: np.ndarray, gazes: np.ndarray, filtering: FilterEntries
) -> Entries:
    """For arguments of these types; compiles both halves if need be."""
    frames = models, task, runs.simulation, runs.step.status, motions, gazes, 0, 0, filtering
    worth = models, task, runs, motions, 0, 0
    return Entries(entry_of(advance_runs, *frames), entry_of(evaluate_runs, *worth), filtering)


def play(models: Models, task: Task, runs: Run, motions: np.ndarray, gazes: np.ndarray, start: int, stop: int) -> None:
    """One step of the runs ``start`` … ``stop - 1``: the one entry of every environment, single or batched.

    ``motions`` (B,) are indices of motions, BEGIN or REST; ``gazes`` (B,) indices of gazes. At the first run this
    process compiles the filter, and another one, `_ahead`, the kernels that are here.
    """
    with_rays = runs.simulation.belief.particles.shape[2] > 0
    if with_rays not in _entries:
        filtering = filter_entries(with_rays)
        _ahead.wait()
        _entries[with_rays] = entries_of(models, task, runs, motions, gazes, filtering)
    play_runs(models, task, runs, motions, gazes, start, stop, _entries[with_rays])


_entries: dict[bool, Entries] = {}
"""What has been compiled, without and with rays; all else in which scenarios differ are numbers, not types."""


@kernel(nogil=True)
def play_runs(
    models: Models,
    task: Task,
    runs: Run,
    motions: np.ndarray,
    gazes: np.ndarray,
    start: int,
    stop: int,
    entries: Entries,
) -> None:
    """Both halves of a step, so that Python hands over the arrays of the runs, which takes its time, only once."""
    simulations, status, filtering = runs.simulation, runs.step.status, entries.filter
    enter(entries.advance_runs, (models, task, simulations, status, motions, gazes, start, stop, filtering))
    enter(entries.evaluate_runs, (models, task, runs, motions, start, stop))


@kernel(nogil=True)
def advance_runs(
    models: Models,
    task: Task,
    simulations: Simulation,
    status: np.ndarray,
    motions: np.ndarray,
    gazes: np.ndarray,
    start: int,
    stop: int,
    filtering: FilterEntries,
) -> None:
    """The frames of a step; ``status`` (B, 2) is that of the steps. Where a run begins, the camera is told to stay."""
    for i in range(start, stop):
        if motions[i] == REST:
            continue
        simulation = row(simulations, i)
        if motions[i] == BEGIN:
            begin_motion(models.motion, simulation.belief, simulation.control, STAY)
        else:
            _play_frames(models, task, simulation, status[i], motions[i], gazes[i], filtering)


@kernel(nogil=True)
def evaluate_runs(models: Models, task: Task, runs: Run, motions: np.ndarray, start: int, stop: int) -> None:
    """What a step was worth, and what is seen of it."""
    simulations = runs.simulation
    steps = runs.step
    for i in range(start, stop):
        if motions[i] == REST:
            continue
        simulation = row(simulations, i)
        step = row(steps, i)
        evaluate(task, simulation, step)
        if motions[i] == BEGIN:
            _begin(step)
        else:
            _settle(task, step)
        observe(models, task, simulation, step)


_ahead = SecondProcess(filter_frame, "activeslam_gym.envs.ahead")
"""Compiles the kernels that are here while this process compiles `filter_frame`."""


@part(inline="always")
def _begin(step: Step) -> None:
    """The prior is worth nothing yet."""
    step.sums[DENSITY_0] = step.potential[DENSITY]
    step.values[LOG_SCORE] = 0.0
    step.status[LOST] = 0  # a run is lost by a step
    for i in range(step.terms.shape[0]):
        step.terms[i] = 0.0


@part(inline="always")
def _play_frames(
    models: Models,
    task: Task,
    simulation: Simulation,
    status: np.ndarray,
    motion: int,
    gaze: int,
    filtering: FilterEntries,
) -> None:
    """The frames of one gaze period; the motion is read where its period begins."""
    if status[STEPS] % task.steps_per_motion == 0:
        begin_motion(models.motion, simulation.belief, simulation.control, motion)
    for i in range(simulation.events.shape[0]):
        simulation.events[i] = 0
    for _ in range(task.frames_per_step):
        advance(models, simulation, gaze, task.labelled_first_match, filtering)
    status[STEPS] += 1


@part(inline="always")
def _settle(task: Task, step: Step) -> None:
    """The reward of the step: the gain of the chosen potential, and if lost the forfeit of all that was gained."""
    reward = step.terms[task.reward]
    step.sums[RETURN] += reward
    step.terms[FORFEIT] = 0.0
    if step.status[LOST] == 1:
        step.terms[FORFEIT] = -max(0.0, step.sums[RETURN])
        step.sums[RETURN] += step.terms[FORFEIT]
    step.sums[REWARD] = reward + step.terms[FORFEIT]
    step.sums[GAIN] += step.terms[ENTROPY_POTENTIAL]


@part(inline="always")
def evaluate(task: Task, simulation: Simulation, step: Step) -> None:
    """Bring the public belief, the expected landmarks, the values and the potentials up to date.

    Where the public covariance is not positive definite the run is lost, and values and potentials stay as they were.
    """
    world = simulation.world
    belief = simulation.belief
    expectation = simulation.expectation
    points, P = simulation.points, simulation.covariance
    N = expectation.points.shape[0]
    K = world.points.shape[0] - N
    n = point_belief(belief, points, P)
    first, after, counting, of_landmark = _ordered_features(belief, expectation, simulation.labels, n)
    U = gathered(P, first, after)
    sound = cholesky_in_place(U)
    find_mapped(belief, task.mapped_depth_ratio, simulation.mapped)
    _evaluate_errors(world, belief, points, P, simulation.labels, simulation.mapped[:n], K, step.values)
    step.status[LOST] = not sound or step.values[POSITION_ERROR] > task.lost_position_error
    step.terms[:] = 0.0
    if not sound:
        return
    dets = log2_dets(expectation, P, U, first, after[: counting - first.shape[0]])
    density = log2_density(world, belief, expectation, points, of_landmark, U, K)
    positions, everything = variance_sums(expectation, P, first, after[: counting - first.shape[0]])
    new = potentials(dets, density, positions, everything, N)
    for i in range(FORFEIT):
        step.terms[i] = new[i] - step.potential[i]
        step.potential[i] = new[i]
    step.values[ENTROPY] = 0.5 * ((CAMERA_DIM + 3 * N) * LOG2_2PIE + dets[TOTAL])
    step.values[LOG2_CAMERA], step.values[LOG2_MAP], step.values[LOG2_TOTAL] = dets[CAMERA], dets[MAP], dets[TOTAL]
    step.values[LOG_SCORE] = density - step.sums[DENSITY_0]


@part(inline="always")
def _ordered_features(
    belief: Belief, expectation: Expectation, labels: Labels, n: int
) -> tuple[np.ndarray, np.ndarray, int, np.ndarray]:
    """The features, by position k, in the order in which the public covariance is factored.

    Returns those that count and stand for a true landmark; the others, those that count first; how many count; and
    (N,) the k that stands for each true landmark, or -1.
    """
    counts = find_counting(expectation, belief)
    of_landmark = features_of_landmarks(labels, belief, expectation.slot.shape[0], counts)
    first, after = np.empty(n, np.int64), np.empty(n, np.int64)
    a, b = 0, 0
    stands = np.zeros(n, np.bool_)
    for k in of_landmark:
        if k >= 0:
            first[a] = k
            stands[k] = True
            a += 1
    for wanted in (True, False):
        for k in range(n):
            if counts[k] == wanted and not stands[k]:
                after[b] = k
                b += 1
    return first[:a], after[:b], count_true(counts), of_landmark


@part(inline="always")
def _evaluate_errors(
    world: World,
    belief: Belief,
    points: np.ndarray,
    P: np.ndarray,
    labels: Labels,
    mapped: np.ndarray,
    K: int,
    values: np.ndarray,
) -> None:
    """Errors against the truth, and counts of what is mapped."""
    error = camera_error(world.camera, belief.camera)
    values[POSITION_ERROR] = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    values[ORIENTATION_ERROR] = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2)
    values[NEES] = nees(error[D_POSITION], P[D_POSITION, D_POSITION])
    of_landmark = features_of_landmarks(labels, belief, world.points.shape[0] - K, mapped)
    distances = landmark_errors(world, points, of_landmark, K)
    count, squares = 0, 0.0
    for distance in distances:
        if not math.isnan(distance):
            count += 1
            squares += distance * distance
    values[MAPPED], values[DISTINCT] = count_true(mapped), count
    values[RMSE] = math.sqrt(squares / count) if count > 0 else np.inf


@part(inline="always")
def observe(models: Models, task: Task, simulation: Simulation, step: Step) -> None:
    """Write the observation; it reads the belief and the task's rhythm only."""
    belief = simulation.belief
    expectation = simulation.expectation
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
        count_true(mapped),
        N - waiting_count(expectation),
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
