"""One step of an environment: frames of simulation, measurement and filter, then evaluation, reward and observation.

`step` is compiled, for the simulated points and the compiled filter; `Perception.step` is the same in Python, for a
scene, a sensor or an estimator of a user's own, and for images.
"""

import math

import numpy as np

from activeslam_gym.envs.disproof import disprove
from activeslam_gym.envs.evaluation import begin_score, evaluate, give_reward, judge_matches, match_to_truth, true_id
from activeslam_gym.envs.observation import FARTHEST_CLEARANCE, observe
from activeslam_gym.envs.run import Run, known_boxes, run_at, write_whole_estimate
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import find_counting, update_expectation
from activeslam_gym.kernels import compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import POSITION, QUATERNION, accelerations, goal_by, turn_by
from activeslam_gym.slam.association import associate
from activeslam_gym.slam.belief import write_outline, write_points
from activeslam_gym.slam.detection import UNASSOCIATED
from activeslam_gym.slam.kalman import predict, update
from activeslam_gym.slam.map import convert_and_delete, count_misses, initialise
from activeslam_gym.slam.sight import sight_of_belief
from activeslam_gym.world.simulator import detect, find_clearance, keep_off, move, stop_short

STEP, BEGIN, REST = 0, -1, -2
"""Orders to a run: a step; begin, as it has just been reset; nothing."""


@compiled
def step_runs(runs: Run, orders: np.ndarray, commands: np.ndarray, start: int, stop: int) -> None:
    """Carry out the ``orders`` (B,) of the runs ``start`` … ``stop - 1``; of a STEP, ``commands`` (B, 4) is the action.

    One kernel for single and batched environments; `perception` has the step with other parts. See `motion.COMMANDS`.
    """
    covariance = runs.estimate.covariance[start]  # one for all: it stays in the processor's cache
    runs.estimate.state[start].whole = False
    for i in range(start, stop):
        run = run_at(runs, i, covariance)
        if orders[i] == STEP:
            step(run, commands[i])
        elif orders[i] == BEGIN:
            begin(run)
        if orders[i] != REST:
            run.estimate.state.whole = stop - start == 1  # the others' covariances wait for `complete`


@compiled
def begin(run: Run) -> None:
    """After a reset: evaluate and observe the prior."""
    write_whole_estimate(run)
    sense_clearance(run)
    evaluate(run)
    begin_score(run)
    observe(run)


@compiled
def step(run: Run, command: np.ndarray) -> None:
    """One gaze period: simulate, measure, predict, associate, update, initialise, evaluate, observe."""
    task = run.models.task
    read_command(run, command, math.inf)
    for frame in range(task.frames_per_step):
        u, contact = simulate(run, command[3])
        labelled = measure(run)
        estimate(run, u, contact, labelled, frame == task.frames_per_step - 1)
        judge(run)
    run.episode.steps += 1
    sense_clearance(run)
    evaluate(run)
    if task.reward >= 0:  # one of the package's own; see `Runs`
        give_reward(run, task.reward)
    observe(run)


@compiled
def estimate(run: Run, u: np.ndarray, contact: bool, labelled: bool, whole: bool) -> None:
    """One frame of the filter, which knows the detections and the accelerations ``u`` (6,), and nothing of the truth.

    ``labelled``: the ids of the detections are certain. Then the estimate is written: the ``whole`` one, or in the
    middle of a step what `judge` reads of it.
    """
    models, belief, fiducials, boxes = run.models, run.ekf, run.world.fiducials, known_boxes(run)
    detections, events = run.detections[: run.episode.detection_count], run.episode.events
    constants = models.filter.initialisation
    predict(models.motion, belief, u, models.motion.dt, contact)
    sight = sight_of_belief(models.lens, belief, fiducials, boxes)  # predicted measurements: z_hat, H, H P and S
    matches = associate(models, belief, boxes, sight, detections, labelled, events)
    count_misses(constants, belief, fiducials.shape[0], sight, matches)
    update(models, belief, fiducials, sight, matches, detections, events)
    convert_and_delete(constants, belief, events)
    initialise(models, belief, detections, events)
    if whole:
        write_whole_estimate(run)
    else:
        write_outline(belief, run.estimate)
        write_points(belief, find_counting(run.expected, run.estimate), run.estimate)


@compiled
def read_command(run: Run, command: np.ndarray, reach: float) -> None:
    """Begin a step: count events from zero, and read the motion of a ``command`` (>= 3,) where its own period begins.

    Its goal is reckoned from the estimated position, and clipped into the room. Where there are boxes it stops short of
    what is in the way, or keeps off it on all sides. ``reach``: so far a foreign scene lets the camera go [m]; infinite
    where there is none.
    """
    events, control, motion = run.episode.events, run.episode.control, run.models.motion
    events.initialised, events.conversions, events.deletions, events.restarts = 0, 0, 0, 0
    events.rejected_matches, events.wrong_matches, events.false_features, events.wall_contacts = 0, 0, 0, 0
    if run.episode.steps % run.models.task.steps_per_motion != 0:
        return
    camera, d = pose_for_control(run), motion.step_length * command[:3]
    copy_into(control.command, command[:3])
    if motion.bodies:
        stop_short(motion, run.world, d, reach)
    elif run.world.state.boxes > 0:  # of a textured room, which no range finder senses
        keep_off(motion, run.world, d)
    copy_into(control.start, camera[POSITION])
    copy_into(control.goal, goal_by(motion, camera, d))
    control.frames = 0


@compiled
def pose_for_control(run: Run) -> np.ndarray:
    """(13,) the camera that the controller reads: the estimate of a robot, the truth where a person's hand moves it.

    A person does not read the filter, and the filter does not know the person's commands.
    """
    return run.estimate.state.camera if run.models.motion.command_known else run.world.state.camera


@compiled
def simulate(run: Run, gaze: float) -> tuple[np.ndarray, bool]:
    """One frame of control and true motion: (6,) the accelerations as the estimator knows them, and a contact.

    ``gaze`` is a share of the turn rate.
    """
    motion, control = run.models.motion, run.episode.control
    turn = turn_by(motion, gaze, run.world.state.frame * motion.dt)
    seconds = control.frames * motion.dt
    u = accelerations(motion, pose_for_control(run), control.start, control.goal, seconds, turn)
    contacts = move(motion, run.world, u)
    run.episode.events.wall_contacts += contacts
    control.frames += 1
    if not motion.command_known:
        u[:] = 0.0
    return u, contacts > 0


@compiled
def measure(run: Run) -> bool:
    """The detections of the frame under way; whether their ids are the true ones."""
    models, world = run.models, run.world
    run.episode.detection_count = detect(models.true_lens, models.sensor, world, run.detections, run.label)
    return identify(run)


@compiled
def identify(run: Run) -> bool:
    """Give the detections their true ids, where the scenario does; whether the frame is labelled so.

    A label is the source of a detection, see `World`; the filter never reads it. An id is of a feature or a fiducial.
    """
    task = run.models.task
    labelled = task.association_known or (task.labelled_first_match and run.world.state.frame == 0)
    for i in range(run.episode.detection_count):
        run.detections[i].id = (
            true_id(run.owner, run.world.fiducials.shape[0], run.label[i]) if labelled else UNASSOCIATED
        )
    return labelled


@compiled
def judge(run: Run) -> None:
    """End the frame (`end_frame`), and count wrong matches and features from clutter by the hidden labels."""
    events, count, K = run.episode.events, run.episode.detection_count, run.world.fiducials.shape[0]
    end_frame(run)
    wrong, false = judge_matches(run.owner, run.estimate, K, run.detections[:count], run.label[:count])
    events.wrong_matches += wrong
    events.false_features += false


@compiled
def end_frame(run: Run) -> None:
    """Features retire expected landmarks, and those looked at and not found are expected elsewhere.

    New features get an entry in the data association with the truth.
    """
    run.world.state.frame += 1
    update_expectation(run.expected, run.models.landmark_var, run.estimate)
    if run.models.negative_information:
        disprove(run)
    match_to_truth(run.owner, run.estimate)


@compiled
def estimate_and_judge(run: Run, u: np.ndarray, contact: bool, labelled: bool, whole: bool) -> None:
    """`estimate` and `judge` in one kernel, for the step in Python, where each call of a kernel costs."""
    estimate(run, u, contact, labelled, whole)
    judge(run)


@compiled
def evaluate_and_observe(run: Run, begins: bool) -> None:
    """The end of `step`, or of `begin` where a run ``begins``, in one kernel, for the step in Python."""
    evaluate(run)
    if begins:
        begin_score(run)
    elif run.models.task.reward >= 0:
        give_reward(run, run.models.task.reward)
    observe(run)


@compiled
def sense_clearance(run: Run) -> None:
    """The range finders of the true camera, where a body may stop it."""
    if run.models.motion.bodies:
        R_WC = rotation_matrix(run.world.state.camera[QUATERNION])
        find_clearance(run.models.motion, run.world, R_WC, FARTHEST_CLEARANCE, run.episode.clearance)
