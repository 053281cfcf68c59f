"""The motion: frame time, controller, process noise, and a gaze that follows a script."""

import math
from dataclasses import dataclass

from activeslam_gym.config import bounds


@dataclass(frozen=True)
class MotionSettings(bounds.Settings):
    """Commanded and disturbed motion of the camera."""

    frame_time: bounds.PositiveFloat = 0.05
    """Time between images [s]."""
    step_length: bounds.PositiveFloat = 0.3
    """Length of one commanded translation [m]."""
    turn_rate: bounds.PositiveFloat = 0.2
    """Rate of a commanded turn about the vertical [rad/s]."""
    controller_frequency: bounds.PositiveFloat = 5.8
    """Natural frequency of the critically damped PD controller [rad/s]."""
    rate_loop_time: bounds.PositiveFloat = 0.1
    """Time constant of the loop on the angular velocity [s]."""
    acceleration_std: bounds.NonNegativeFloat = 0.5
    """True process noise of the linear acceleration, each axis, held for a frame [m/s^2]."""
    angular_acceleration_std: bounds.NonNegativeFloat = 0.5
    """True process noise of the angular acceleration, each axis, held for a frame [rad/s^2]."""
    filter_acceleration_std: bounds.PositiveFloatOrNone = None
    """Process noise that the filter assumes [m/s^2]; None: ``acceleration_std``."""
    filter_angular_acceleration_std: bounds.PositiveFloatOrNone = None
    """Process noise that the filter assumes [rad/s^2]; None: ``angular_acceleration_std``."""
    command_known: bounds.Switch = True
    """Whether the filter knows the commanded acceleration. False: the filter assumes zero. A person holds the camera,
    who moves it without the filter's estimate."""
    scripted_gaze_amplitude: bounds.NonNegativeFloat = 0.0
    """If positive, the gaze swings by this angle to each side by itself and gaze actions have no effect [rad]."""
    scripted_gaze_period: bounds.PositiveFloat = 20.0
    """Period of that swing [s]."""

    def _check(self) -> None:
        super()._check()
        fastest, least = 2.0 * (math.sqrt(2.0) - 1.0) / self.frame_time, self.frame_time / 2
        allowed = f"under {fastest:.3g} rad/s, 0.83 / frame_time: a faster controller is unstable"
        self._demand("controller_frequency", self.controller_frequency < fastest, allowed)
        allowed = f"over {least:.3g} s, half of frame_time, to be stable"
        self._demand("rate_loop_time", self.rate_loop_time > least, allowed)
