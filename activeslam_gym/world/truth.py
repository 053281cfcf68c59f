"""The ground truth as the evaluator and a sensor read it; never a policy, and never an estimator."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from activeslam_gym.motion import CAMERA_PARTS
from activeslam_gym.world.simulator import World


@dataclass(frozen=True)
class Truth:
    """The ground truth of one run; read-only copies. Of a batch, with a leading axis."""

    position: np.ndarray
    """(3,) [m]."""
    quaternion: np.ndarray
    """(4,) q_WC, scalar first."""
    velocity: np.ndarray
    """(3,) [m/s], world frame."""
    angular_velocity: np.ndarray
    """(3,) [rad/s], world frame."""
    landmarks: np.ndarray
    """(L, 3) [m]."""
    fiducials: np.ndarray
    """(K, 3) [m]."""
    boxes: np.ndarray
    """(B, 2, 3) lowest and highest corners [m]; the entries of boxes that a room does not have are zero."""
    scene: Any = None
    """The `Scene`, which tells what hides and what stops; of a batch, a tuple of them."""

    @property
    def camera(self) -> np.ndarray:
        """(13,) position, quaternion and velocities."""
        return np.concatenate((self.position, self.quaternion, self.velocity, self.angular_velocity), axis=-1)


def truth_of(world: World, scene: Any = None) -> Truth:
    """The ground truth of a world with its ``scene``, or of a batch of them: the same with a leading axis."""
    arrays = {name: np.array(world.state["camera"][..., part]) for name, part in CAMERA_PARTS.items()}
    arrays |= {name: np.array(getattr(world, name)) for name in ("landmarks", "fiducials", "boxes")}
    for array in arrays.values():
        array.flags.writeable = False
    return Truth(**arrays, scene=scene)
