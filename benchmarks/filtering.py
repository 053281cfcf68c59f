"""The filter without association on a map of points, which a plain EKF does too; and its frames with all they do."""

import numpy as np

from activeslam_gym.envs.run import Run, run_at
from activeslam_gym.envs.simulation import advance, begin_motion
from activeslam_gym.kernels import compiled
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.correction import correct
from activeslam_gym.slam.filter import Filter
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.sight import sight_of_belief

from .setups import SEEN, fill_with_points, map_scenario, points_around


@compiled
def advance_frames(runs: Run, command: np.ndarray, frames: int) -> None:
    """Begin a motion of the first of ``runs``, and go on for so many frames, as a step does, without their worth.

    ``command`` (4,) as in `motion.COMMANDS`.
    """
    run = run_at(runs, 0, runs.estimate.covariance[0])
    begin_motion(run, command, np.inf)
    for frame in range(frames):
        advance(run, command[3], frame == frames - 1)


@compiled
def predict_and_update(
    camera: np.record, motion: np.record, belief: Belief, fiducials: np.ndarray, boxes: np.ndarray, frames: int
) -> int:
    """``frames`` times predict, and update by everything in view at its predicted pixel; how much was seen at last."""
    seen = 0
    for _ in range(frames):
        predict(motion, belief, np.zeros(6), motion.dt)
        sight = sight_of_belief(camera, belief, fiducials, boxes)
        seen = sight.thing.shape[0]
        pixels = np.empty(2 * seen)
        for r in range(2 * seen):
            pixels[r] = sight.thing[r // 2].z_hat[r % 2]
        correct(camera, belief, fiducials, sight, pixels)
    return seen


class PointFilter:
    """`predict_and_update` on a map of ``landmarks`` points, `SEEN` of them in view."""

    def __init__(self, landmarks: int) -> None:
        rng, self._filter = np.random.default_rng(landmarks), Filter(map_scenario(landmarks))
        self.belief = self._filter.belief
        fill_with_points(self.belief, points_around(landmarks, rng), rng)
        if (seen := self.run(1)) != SEEN:
            raise RuntimeError(f"{seen} points in view instead of {SEEN}")

    def run(self, frames: int) -> int:
        """So many frames; the points seen in the last."""
        f = self._filter
        return predict_and_update(f.camera, f.models.motion, f.belief, f.fiducials, f.boxes, frames)
