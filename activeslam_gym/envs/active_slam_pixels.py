"""``ActiveSLAMPixels-v0``: the same environment on images of a textured room instead of points."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMEnv
from activeslam_gym.envs.active_slam_vector import ActiveSLAMVectorEnv
from activeslam_gym.sensors.sensor import IMAGES


class ActiveSLAMPixelsEnv(ActiveSLAMEnv):
    """`ActiveSLAMEnv` on images: the same actions, observation, rewards, scores and ends, and another sensor.

    The room has textured walls, posters, and boxes that hide what is behind them. Its image is rendered through the
    lens, with noise, blur of motion and drifting gain, and is a function of the seed, the frame and the camera's true
    state alone. The front end of `vision` searches the features of the belief in it, and adds and drops features. The
    fiducials are the four corners of a black rectangle of known size, which hangs before the start.

    What differs:

    - ``scenario`` is ``"pixels"`` by default. Its ``fiducial_count`` must be 4, its ``initialisation``
      ``inverse_depth``, and it must have no ``boxes`` (drawn ones and inner walls neither), no clutter, no missed
      detections and no labelled first match: the image has its own. The start is not ``anywhere``; the layout of the
      landmarks is ``uniform``, a furnished room whose walls, floor and boxes have textures, or ``clusters``: a bare
      room with ``cluster_count`` groups of posters on its walls. The greatest distance stays as in ``paper``, and
      nothing is varied. The front end associates and deletes features by their looks, so that ``association``,
      ``restarts``, ``maximum_misses``, ``miss_spacing`` and ``inverse_depth_memory`` must keep their defaults.
    - ``landmark_count``, N, bounds the map (N + 13 features) instead of telling how many points the room has.
    - Truth of a landmark is the scene point that its feature follows, by ray-casting. Of the N slots of the log
      score, one without a feature scores a random point of the room by the prior.
    - A match is wrong where the feature's scene point is more than 4 pixels from it in the true image.
    - The room's boxes stop the camera, and a motion stops short of them; the belief knows nothing of them, and nothing
      tells how far they are.

    Raises:
        ValueError: a bad argument or action.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(self, scenario: str | Mapping[str, Any] | Scenario = "pixels", **arguments: Any) -> None:
        super().__init__(scenario, sensor=IMAGES, **arguments)

    @property
    def image(self) -> np.ndarray:
        """(H, W) uint8 the last image; a copy."""
        return self._perceptions[0].image.copy()


class ActiveSLAMPixelsVectorEnv(ActiveSLAMVectorEnv):
    """``ActiveSLAMPixels-v0`` a batch at a time: what `ActiveSLAMVectorEnv` is to `ActiveSLAMEnv`."""

    def __init__(
        self, num_envs: int = 1, scenario: str | Mapping[str, Any] | Scenario = "pixels", **arguments: Any
    ) -> None:
        super().__init__(num_envs, scenario, sensor=IMAGES, **arguments)
