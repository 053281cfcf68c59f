"""Where the microseconds of a frame go: a step that stops after each of its stages, in the middle of a sweep."""

from functools import partial

import numpy as np

from activeslam_gym.envs.episode import STEP, appraise, observe, open_step, play
from activeslam_gym.envs.run import Run, known_boxes, present, run_at
from activeslam_gym.envs.simulation import account, drive, sense
from activeslam_gym.kernels import compiled
from activeslam_gym.motion import COMMANDS, Gaze, Motion
from activeslam_gym.slam.association import associate
from activeslam_gym.slam.frame import initialise, use_detections
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.sight import sight_of_belief

from .report import Section
from .setups import restoring, swept
from .timing import TURN, restored

STAGES = (
    "handing over the arrays of a run",
    "control, true motion",
    "detection",
    "prediction",
    "predicted pixels, H P, S",
    "association",
    "update, conversions, deletions",
    "births",
    "estimate",
    "hidden labels, expected landmarks",
    "evaluation",
    "observation",
)


@compiled
def step_until(runs: Run, command: np.ndarray, last: int) -> None:
    """A step of one frame of the first of ``runs``, as `play` makes it, until stage ``last`` of `STAGES`."""
    run = run_at(runs, 0, runs.estimate.covariance[0])
    models, belief, fiducials, boxes = run.models, run.ekf, run.world.fiducials, known_boxes(run)
    if last == 0:
        return
    open_step(run, command, np.inf)
    u, _ = drive(run, command[3])
    if last == 1:
        return
    labelled = sense(run)
    candidates = run.candidate[: run.episode.detections]
    if last == 2:
        return
    predict(models.motion, belief, u, models.motion.dt)
    if last == 3:
        return
    sight = sight_of_belief(models.camera, belief, fiducials, boxes)
    if last == 4:
        return
    if last == 5:
        waits = np.zeros(sight.thing.shape[0], np.bool_)
        associate(models.filter.association, sight, candidates, belief.state.count, waits)
        return
    events = run.episode.events
    use_detections(models, belief, fiducials, boxes, sight, candidates, labelled, events)
    if last == 6:
        return
    initialise(models, belief, candidates, events)
    if last == 7:
        return
    present(run)
    if last == 8:
        return
    account(run)
    if last == 9:
        return
    appraise(run, False)
    if last == 10:
        return
    observe(run)
    run.estimate.state.whole = False


def run(quick: bool) -> Section:
    """The table of stages, and their sum beside the whole step.

    Raises:
        RuntimeError: the stages do not make the step that `play` makes.
    """
    section, env = Section("Where the microseconds of a frame go"), swept(0)
    runs, command = env.unwrapped._runs, COMMANDS[Motion.RIGHT, Gaze.LEFT]
    whole = partial(play, runs, np.array([STEP]), command[None], 0, 1)
    steps = [partial(step_until, runs, command, last) for last in range(len(STAGES))]
    restore, count = restoring(runs), 100 if quick else 1000
    *ends, of_play = 1e6 * restored([*steps, whole], restore, count).min(axis=0)
    made = []
    for step in (steps[-1], whole):
        restore()
        step()
        made.append((runs.observation.tobytes(), runs.episode.tobytes(), runs.ekf.covariance.tobytes()))
    if made[0] != made[1]:
        raise RuntimeError("the stages of benchmarks/stages.py do not make the step that `play` makes")
    times = {"a step of one frame (`play`)": of_play, **dict(zip(STAGES, np.diff(ends, prepend=0.0)))}
    times["sum of the stages"] = ends[-1]
    section.rows = [{"stage": name, "time [µs]": time, "share": time / of_play} for name, time in times.items()]
    estimate, detections = runs.estimate.state[0], runs.candidate["match"][0, : runs.episode[0].detections]
    section.notes.append(
        f"One frame after 20 s of `sweep`: {estimate['count']} features, {runs.ekf.state[0].dim} covariance rows, "
        f"{(detections != 0).sum()} matches. One compiled function calls the stages of a frame and returns after any "
        f"of them; a stage is the difference of two times. Each of these is the lowest of {count // TURN} medians of "
        f"{TURN} calls, all on the same arrays put back by a copy. The sum is the time of the function to its end. It "
        "makes the same step as `play` to the bit; they differ by how the compiler merges the stages."
    )
    env.close()
    return section
