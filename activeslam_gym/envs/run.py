"""All arrays of a run: its constants, the truth, the estimate, and the score so far."""

from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import CAMERA
from activeslam_gym.envs.reward import EVALUATION, REWARDS
from activeslam_gym.kernels import Record, borrowed, compiled, inlined, record
from activeslam_gym.motion import MOTION, MOTION_COUNT
from activeslam_gym.slam.belief import Belief, belief_at, write_estimate
from activeslam_gym.slam.estimate import EstimateArrays, estimate_at
from activeslam_gym.slam.filter import COUNTS, FILTER
from activeslam_gym.world.simulator import SENSOR, World, boxes_of, world_at

TASK = record(
    frames_per_step="i8",
    steps_per_motion="i8",
    steps="i8",  # of an episode
    reward="i8",  # its number in `REWARDS`, or FOREIGN
    lost_position_error="f8",  # [m]
    end_when_lost="b1",
    labelled_first_match="b1",
    association_known="b1",
)
"""What an environment asks: its rhythm, its reward, and when a run is lost."""

MODELS = record(
    lens=CAMERA,  # as the filter knows it
    true_lens=CAMERA,
    motion=MOTION,
    sensor=SENSOR,
    greatest_change="f8",  # see `SensorLimits`
    wanted="i8",
    filter=FILTER,
    task=TASK,
    landmark_var=("f8", 3),  # of a landmark anywhere in the room, each axis [m^2]
    on_surfaces="b1",  # whether landmarks are expected on the walls
    boxes_known="b1",  # whether the belief knows what occludes
    negative_information="b1",  # whether what was looked at and not found is expected elsewhere
)
"""The constants of a run."""

CONTROL = record(
    goal=("f8", 3),  # of the motion under way [m]
    start=("f8", 3),  # where the reference towards the goal began [m]
    command=("f8", 3),  # the translation under way: camera axes, of which 1 is a step
    frames="i8",  # since it began
)
"""The motion under way."""

OWNER = record(
    id="i8",  # of the landmark of the estimate; 0: none
    slot="i8",  # its place in the observation, for life
    label="i8",  # of the detection that initialised it, or UNKNOWN
    landmark="i8",  # index of that true landmark, or NO_OWNER
)
"""The data association, by hidden labels, of one landmark of the estimate."""
NO_OWNER = -1
UNKNOWN = -2  # the label of a landmark of which no detection is known yet

_OF_THE_FILTER = COUNTS.names or ()
EVENTS = record(**dict.fromkeys((*_OF_THE_FILTER, "wrong_matches", "false_features", "wall_contacts"), "i8"))
"""What happened in a step: counters."""

EPISODE = record(
    control=CONTROL,
    events=EVENTS,
    evaluation=EVALUATION,
    potential=("f8", (len(REWARDS) + 1,)),  # after the last step, by number; the last one is a foreign reward's
    gains=("f8", (len(REWARDS) + 2,)),  # of the potentials in the last step; the failure penalty is the last but one
    reward="f8",  # of the last step
    total="f8",  # return so far
    entropy_reduction="f8",  # so far [bit]
    first_density="f8",  # log_density at the reset [bit]
    steps="i8",  # so far
    begun="b1",  # there has been a reset
    lost="b1",  # in this step or before
    lost_now="b1",
    sound="b1",  # the estimate is finite, and its covariance positive definite
    detection_count="i8",  # of the last frame
    views="i8",  # viewpoints so far
    clearance=("f8", (MOTION_COUNT,)),  # how far the camera can go by each motion, where there are boxes [m]
    redraw_key=("u8", (1,)),  # the stream of expected landmarks that are drawn again
)
"""The progress of one run: its controller, what happened, and what it has been worth so far."""


class Run(NamedTuple):
    """A run; a batch of runs has a leading axis. F feature slots, N = L landmarks, K fiducials, M detections."""

    models: Record  # MODELS
    world: World  # the truth
    ekf: Belief  # the belief of the filter, in its own parameters: only `slam` reads it
    estimate: EstimateArrays  # the same with a point for each feature, or a foreign estimator's: all else reads this
    expected: np.ndarray  # (N,) EXPECTED landmarks
    viewpoint: np.ndarray  # (V,) VIEW from which was looked for them; V = 0 without negative information
    detections: np.ndarray  # (M,) DETECTION: the last frame's detections, as the filter gets them
    label: np.ndarray  # (M,) of what each of them is; see `World`. For scoring, and where association is known
    first_seen: np.ndarray
    """(F, 3) where the camera was when each landmark of the estimate was initialised [m]; (0, 3) where that does not
    limit the sensor."""
    owner: np.ndarray  # (F,) OWNER, of the landmarks of the estimate in their order. For scoring, but `slot`
    episode: Record  # EPISODE
    observation: np.ndarray  # (D,) float32


@inlined
def run_at(runs, i, covariance):  # type: ignore[no-untyped-def]
    """Run ``i`` of a batch: views; the covariance of its estimate is the array ``covariance``."""
    return Run(
        runs.models[i],
        world_at(runs.world, i),
        belief_at(runs.ekf, i),
        estimate_at(runs.estimate, i, covariance),
        borrowed(runs.expected[i]),
        borrowed(runs.viewpoint[i]),
        borrowed(runs.detections[i]),
        borrowed(runs.label[i]),
        borrowed(runs.first_seen[i]),
        borrowed(runs.owner[i]),
        runs.episode[i],
        borrowed(runs.observation[i]),
    )


@compiled
def known_boxes(run: Run) -> np.ndarray:
    """The boxes that the belief knows to hide landmarks: all of the world's, or none."""
    boxes = boxes_of(run.world)
    return boxes if run.models.boxes_known else boxes[:0]


@compiled
def write_whole_estimate(run: Run) -> None:
    """Write the whole estimate."""
    write_estimate(run.ekf, run.models.filter.initialisation.mapped_depth_ratio, run.estimate)


@compiled
def complete(runs: Run, start: int, stop: int) -> None:
    """Write the whole estimates of the runs ``start`` … ``stop - 1`` where that was not done yet."""
    for i in range(start, stop):
        run = run_at(runs, i, runs.estimate.covariance[i])
        if not run.estimate.state.whole:
            write_whole_estimate(run)
