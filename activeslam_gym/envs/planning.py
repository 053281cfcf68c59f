"""The predicted belief that policies plan with, and the scores of plans, of each run of a batch."""

import numpy as np

from activeslam_gym.envs.observation import FARTHEST_CLEARANCE
from activeslam_gym.envs.run import Run, known_boxes, run_at, write_whole_estimate
from activeslam_gym.information.candidates import PredictedBelief, SensorLimits, predicted_belief_of, score_plans
from activeslam_gym.information.net import net_of_plans
from activeslam_gym.kernels import compiled
from activeslam_gym.motion import MOTION_COUNT


@compiled
def predicted_belief(run: Run) -> PredictedBelief:
    """The predicted belief of a run."""
    if not run.estimate.state.whole:
        write_whole_estimate(run)
    fiducials, clearance = run.world.fiducials, np.full(MOTION_COUNT, np.inf)  # fiducials are known
    if run.models.motion.bodies:
        for index in range(MOTION_COUNT):
            if run.episode.clearance[index] < FARTHEST_CLEARANCE:
                clearance[index] = run.episode.clearance[index]
    models, boxes, first_seen = run.models, known_boxes(run), run.first_seen[: run.estimate.state.count]
    var, limits = models.landmark_var, SensorLimits(models.greatest_change, models.wanted)
    return predicted_belief_of(run.estimate, run.expected, var, fiducials, boxes, clearance, limits, first_seen)


@compiled
def score_runs(
    runs: Run, plans: np.ndarray, step_time: float, criterion: int, out: np.ndarray, start: int, stop: int
) -> None:
    """Write the scores of ``plans`` (A, L) for the runs ``start`` … ``stop - 1`` into their rows of ``out``."""
    for i in range(start, stop):
        run = run_at(runs, i, runs.estimate.covariance[i])
        models, time = run.models, run.episode.steps * step_time
        score_plans(models.lens, models.motion, predicted_belief(run), time, plans, criterion, out[i])


@compiled
def frames_left(run: Run) -> int:
    """Frames to the end of the episode."""
    return (run.models.task.steps - run.episode.steps) * run.models.task.frames_per_step


@compiled
def net_of_runs(runs: Run, plans: np.ndarray, step_time: float, out: np.ndarray, start: int, stop: int) -> None:
    """Write the `Forecast` of ``plans`` (A, L) for the runs ``start`` … ``stop - 1``, till they end, into (2, B, A)."""
    for i in range(start, stop):
        run = run_at(runs, i, runs.estimate.covariance[i])
        models, time, left = run.models, run.episode.steps * step_time, frames_left(run)
        net_of_plans(models.lens, models.motion, predicted_belief(run), time, left, plans, out[0, i], out[1, i])
