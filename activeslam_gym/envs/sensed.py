"""A frame of a run whose detections come from somebody else: the kernels before and after the front end's turn."""

import numpy as np

from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.envs.episode import conclude, open_step
from activeslam_gym.envs.referee import NOBODY, UNKNOWN, reconcile
from activeslam_gym.envs.simulation import Run, begin_motion, close_frame, drive, present, run_at
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.expectation import WAITING
from activeslam_gym.kernels import compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.estimate import index_of
from activeslam_gym.world.simulator import CLUTTER_LABEL

WRONG_PX = 4.0
"""A match farther than this from where its point really is in the image is wrong: the noise is under a pixel."""


@compiled
def begin(runs: Run, i: int) -> None:
    """Evaluate run ``i``, which has just been reset."""
    run = run_at(runs, i)
    present(run)
    begin_motion(run, np.zeros(3))
    conclude(run, True)


@compiled
def move(runs: Run, i: int, command: np.ndarray, opens: bool) -> np.ndarray:
    """One frame of true motion of run ``i`` under ``command`` (4,); (6,) what the filter knows of the accelerations.

    ``opens``: it is the first of a step.
    """
    run = run_at(runs, i)
    if opens:
        open_step(run, command)
    return drive(run, command[3])


@compiled
def enter(runs: Run, i: int) -> None:
    """After the filter: write the estimate of run ``i``, and let each of its landmarks have its entry in ``owner``."""
    run = run_at(runs, i)
    present(run)
    reconcile(run.owner, run.estimate)


@compiled
def account(runs: Run, i: int, scene_points: np.ndarray, spare: np.ndarray) -> None:
    """After `enter`: which matches were right, and which scene point each of the N slots of the score stands for.

    ``scene_points`` (n, 3): of each landmark of the estimate, the scene point of the pixel that initialised it. The
    slot of the expected landmark that a feature has retired is the feature's; of an empty one, ``spare`` (N, 3),
    anywhere in the room, is the truth.
    """
    run = run_at(runs, i)
    world, estimate, expected, owner = run.world, run.estimate, run.expected, run.owner
    close_frame(run)
    for k in range(estimate.state.count):
        owner[k].label, owner[k].landmark = UNKNOWN, NOBODY
    for e in range(expected.shape[0]):
        k = index_of(estimate, expected[e].serial) if expected[e].serial != WAITING else -1
        if k >= 0:
            owner[k].landmark = e
            copy_into(world.landmarks[e], scene_points[k])
        else:
            copy_into(world.landmarks[e], spare[e])
    for c in range(run.episode.detections):
        run.label[c] = _label(run, scene_points, run.candidate[c].match, run.candidate[c].pixel)


@compiled
def _label(run: Run, scene_points: np.ndarray, match: int, pixel: np.ndarray) -> int:
    """Of what a detection was that was taken for ``match``: see `Labels`. Counts it where it was of something else."""
    world, K = run.world, run.world.fiducials.shape[0]
    k, label, point = -1, CLUTTER_LABEL, world.state.camera[:3]
    if match > 0:
        k = index_of(run.estimate, match)
    if k >= 0:
        point = scene_points[k]
        if run.owner[k].landmark != NOBODY:
            label = K + run.owner[k].landmark
    elif -K <= match < 0:
        point, label = world.fiducials[-1 - match], -1 - match
    if k >= 0 or -K <= match < 0:
        z, pose = np.empty(2), world.state.camera
        p_C = camera_point(rotation_matrix(pose[QUATERNION]), pose, point)
        seen = pixel_from_camera_point(run.models.true_camera, p_C, z)
        if not seen or (z[0] - pixel[0]) ** 2 + (z[1] - pixel[1]) ** 2 > WRONG_PX**2:
            run.episode.events.wrong_matches += 1
            label = CLUTTER_LABEL
    return label


@compiled
def finish(runs: Run, i: int) -> None:
    """After the frames of a step."""
    run = run_at(runs, i)
    conclude(run, False)
