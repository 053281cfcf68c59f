"""One step of an environment: some frames, then what they were worth and what is seen of them."""

import math
from typing import Any

import numpy as np

from activeslam_gym.envs.identity import features_of_landmarks, landmark_errors
from activeslam_gym.envs.observation import FARTHEST_CLEARANCE, observe
from activeslam_gym.envs.reward import EVALUATION, LOST_PENALTY, REWARDS, Potential, potential_of_number
from activeslam_gym.envs.run import EVENTS, Run, run_at, write_whole_estimate
from activeslam_gym.envs.simulation import begin_motion, measure, simulate, update_estimate
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import LOG2_2PIE, gathered, log2_dets, traces
from activeslam_gym.information.expectation import find_counting
from activeslam_gym.kernels import borrowing, compiled, row, uncompiled
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.metrics import UNSOUND_LOG_SCORE, camera_error, is_lost, log2_density, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION, QUATERNION
from activeslam_gym.registry import FOREIGN, number_from
from activeslam_gym.world.simulator import find_clearance

STEP, BEGIN, REST = 0, -1, -2  # what a run does: a step; evaluate itself, as it has just been reset; nothing
_ENTROPY = list(REWARDS).index("entropy")
_LOST_PENALTY = len(REWARDS)  # entry of `terms` behind those of the package's rewards
LOSS = 100.0  # what a loss costs, beside all that was gained [bit]


@compiled
def step_runs(runs: Run, phases: np.ndarray, commands: np.ndarray, start: int, stop: int) -> None:
    """One step of the runs ``start`` … ``stop - 1``: the one entry of every environment, single or batched.

    ``phases`` (B,) are STEP, BEGIN or REST; ``commands`` (B, 4) as in `motion.COMMANDS`; those of a BEGIN are zero.
    """
    covariance = runs.estimate.covariance[start]  # one for all: it stays in the processor's cache
    runs.estimate.state[start].whole = False
    for i in range(start, stop):
        if phases[i] == REST:
            continue
        run = run_at(runs, i, covariance)
        step(run, commands[i], phases[i] == BEGIN)
        run.estimate.state.whole = stop - start == 1  # the others' covariances wait for `complete`


@compiled
def step(run: Run, command: np.ndarray, begins: bool) -> None:
    """One gaze period: simulate, measure, predict, associate, update, initialise, evaluate, observe.

    Where a run ``begins``, its prior alone is evaluated and observed. The reference of it is `perception.step`.
    """
    if begins:
        write_whole_estimate(run)
    start_step(run, command, math.inf, begins)
    frames = 0 if begins else run.models.task.frames_per_step
    for frame in range(frames):
        u, contact = simulate(run, command[3])
        labelled = measure(run)
        update_estimate(run, u, contact, labelled, frame == frames - 1)
    end_step(run, begins)


@borrowing
def start_step(run: Run, command: np.ndarray, reach: float, begins: bool) -> None:
    """Before the frames of a gaze period; the motion is read where its own period begins, see `begin_motion`."""
    episode, events = run.episode, run.episode.events
    if begins or episode.steps % run.models.task.steps_per_motion == 0:
        begin_motion(run, command, reach)
    events.initialised, events.conversions, events.deletions, events.restarts = 0, 0, 0, 0
    events.rejected_matches, events.wrong_matches, events.false_features, events.wall_contacts = 0, 0, 0, 0
    episode.steps += not begins


@compiled
def end_step(run: Run, begins: bool) -> None:
    """After the frames: evaluate them, measure the clearance where a body may stop the camera, and observe."""
    evaluate(run)
    episode = run.episode
    if begins:  # the prior is worth nothing yet, and a run is lost by a step
        episode.first_density = episode.evaluation.log_density
        episode.evaluation.log_score = 0.0
        episode.lost, episode.lost_now = False, False
        episode.terms[:] = 0.0
    else:
        episode.gain += episode.terms[_ENTROPY]
        if run.models.task.reward >= 0:  # one of the package's own; see `give_foreign_reward`
            _give_reward(run)
    if run.models.motion.bodies:
        R_WC = rotation_matrix(run.world.state.camera[QUATERNION])
        find_clearance(run.models.motion, run.world, R_WC, FARTHEST_CLEARANCE, run.episode.clearance)
    observe(run)


@borrowing
def _give_reward(run: Run) -> None:
    """The reward of the step: the gain of the chosen potential; where the run is lost, the return is min(it, 0) - 100.

    A run can be lost once: the failure penalty is due in the first such step.
    """
    episode = run.episode
    first = episode.lost_now and not episode.lost
    episode.lost = episode.lost or episode.lost_now
    episode.reward = episode.terms[run.models.task.reward]
    episode.total += episode.reward
    lost_penalty = -max(0.0, episode.total) - LOSS if first else 0.0
    episode.terms[_LOST_PENALTY] = lost_penalty
    episode.total += lost_penalty
    episode.reward += lost_penalty


def give_foreign_reward(name: str, potential: Potential, runs: Run, phases: np.ndarray) -> None:
    """After `step_runs`: a foreign ``potential`` of that ``name``, and the reward of the step.

    Where the estimate is not sound, the potential keeps its value. ``phases`` (B,) as in `step_runs`.
    """
    for i in np.flatnonzero(phases != REST).tolist():
        episode = runs.episode[i]
        before = float(episode.potential[FOREIGN])
        if episode.sound:
            where = f"after {episode.steps} steps of environment {i}"
            episode.potential[FOREIGN] = number_from(
                f"reward {name!r}", potential, episode.evaluation.copy(), where=where
            )
        if phases[i] == STEP:
            episode.terms[FOREIGN] = episode.potential[FOREIGN] - before
            uncompiled(_give_reward)(row(runs, i))


@compiled
def evaluate(run: Run) -> None:
    """Bring the evaluation and the potentials up to date, from the estimate; ``terms`` become the potentials' gains.

    Where its covariance is not positive definite, the log score is UNSOUND_LOG_SCORE and the other potentials keep
    their values.
    """
    estimate, episode, var = run.estimate, run.episode, run.models.landmark_var
    e, N, covariance = episode.evaluation, run.expected.shape[0], estimate.covariance
    counting = find_counting(run.expected, estimate)
    of_landmark = features_of_landmarks(run.owner, N, counting)
    # Features are factored in this order: those that stand for a true landmark, the others that count, the rest.
    standing, others = of_landmark[of_landmark >= 0], counting.copy()
    others[standing] = False
    order = np.concatenate((standing, np.flatnonzero(others), np.flatnonzero(~counting)))
    counted, U = order[: np.sum(counting)], gathered(covariance, standing, order[standing.shape[0] :])
    sound = cholesky_in_place(U)
    _evaluate_errors(run)
    episode.lost_now = is_lost(sound, e.position_error, run.models.task.lost_position_error)
    episode.sound = sound and not math.isnan(e.position_error)
    if sound:
        waiting = N - counted.shape[0]
        log2_dets(var, waiting, covariance, U, counted, standing.shape[0], e)
        e.landmarks = N
        e.entropy = 0.5 * ((CAMERA_DIM + 3 * N) * LOG2_2PIE + e.log2_det_total)
        truth, camera, points = run.world.state.camera, estimate.state.camera, estimate.landmark["point"]
        e.log_density = log2_density(truth, run.world.landmarks, camera, points, var, of_landmark, U)
        e.position_trace, e.trace = traces(var, waiting, covariance, counted)
    else:
        e.log_density = episode.first_density + UNSOUND_LOG_SCORE
    e.log_score = e.log_density - episode.first_density
    for i in range(_LOST_PENALTY):
        potential = potential_of_number(i, e)
        episode.terms[i] = potential - episode.potential[i]
        episode.potential[i] = potential


@compiled
def _evaluate_errors(run: Run) -> None:
    """Errors against the truth, and counts of mapped landmarks."""
    e, estimate = run.episode.evaluation, run.estimate
    error = camera_error(run.world.state.camera, estimate.state.camera)
    p, theta = error[D_POSITION], error[D_ROTATION]
    e.position_error = math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
    e.orientation_error = math.sqrt(theta[0] ** 2 + theta[1] ** 2 + theta[2] ** 2)
    e.position_nees = nees(p, estimate.covariance[D_POSITION, D_POSITION]) / 3.0
    count, squares = 0, 0.0
    for distance in landmark_errors(run.owner, run.world.landmarks, estimate):
        if not math.isnan(distance):
            count, squares = count + 1, squares + distance * distance
    e.landmarks_mapped, e.distinct_landmarks = np.sum(estimate.landmark["mapped"][: estimate.state.count]), count
    e.landmark_rmse = math.sqrt(squares / count) if count > 0 else np.inf


_TOLD = (
    "entropy log_score landmarks_mapped distinct_landmarks position_error orientation_error landmark_rmse position_nees"
).split()
"""Fields of the evaluation that `info` has under their own names."""


def info_of(runs: Run, reward: str) -> dict[str, Any]:
    """The `info` of the last step of a single run, of plain Python values; ``reward`` is that of the environment."""
    episode = runs.episode  # fields of arrays: those of a single record are slow to read
    values = dict(zip(EVALUATION.names or (), episode["evaluation"].tolist()[0], strict=True))
    lost = bool(episode["lost"][0]), bool(episode["lost_now"][0])
    return _tree(values, lost, reward, episode["terms"][0].tolist(), episode["events"].tolist()[0])


def infos_of(runs: Run, reward: str, included: np.ndarray) -> dict[str, Any]:
    """The `infos` of the last step of a batch, as Gymnasium's vector environments have them.

    An array (B,) for each number of `info_of`, in the same nested dicts, and beside each ``key`` a mask ``_key`` (B,)
    of the environments that it is of: those ``included`` (B,) bool; the others' numbers are 0.
    """

    everyone = bool(included.all())

    def kept(column: np.ndarray) -> np.ndarray:
        return column.copy() if everyone else np.where(included, column, column.dtype.type(0))

    episode = runs.episode
    values = {name: kept(episode["evaluation"][name]) for name in EVALUATION.names or ()}
    terms, events = map(kept, episode["terms"].T), (kept(episode["events"][name]) for name in EVENTS.names or ())
    lost = kept(episode["lost"]), kept(episode["lost_now"])
    return with_masks(_tree(values, lost, reward, terms, events), included)


def _tree(values: dict[str, Any], lost: Any, reward: str, terms: Any, events: Any) -> dict[str, Any]:
    """The tree of `info`, of the numbers of one run or of columns (B,) of numbers."""
    info: dict[str, Any] = {name: values[name] for name in _TOLD}
    info["log2_det"] = {part: values[f"log2_det_{part}"] for part in ("camera", "map", "total")}
    info["lost"], info["lost_at_end"] = lost
    names = (*REWARDS, LOST_PENALTY, *([reward] if reward not in REWARDS else []))
    info["reward_terms"] = dict(zip(names, terms, strict=False))  # the last term is a foreign reward's
    info["events"] = dict(zip(EVENTS.names or (), events, strict=True))
    return info


def with_masks(infos: dict[str, Any], included: np.ndarray) -> dict[str, Any]:
    """``infos`` with a mask ``_key`` beside each ``key``, in nested dicts too."""
    masked: dict[str, Any] = {}
    for key, value in infos.items():
        masked[key] = with_masks(value, included) if isinstance(value, dict) else value
        masked[f"_{key}"] = included.copy()
    return masked


def info_at(infos: dict[str, Any], i: int) -> dict[str, Any]:
    """The `info` of environment ``i`` in the `infos` of a batch: the inverse of `infos_of`."""
    return {
        key: info_at(value, i) if isinstance(value, dict) else value[i].item()
        for key, value in infos.items()
        if not key.startswith("_")
    }
