"""The lens and the detector: the image, the camera model, and the noise of measurements."""

from dataclasses import dataclass

from activeslam_gym.config import bounds


@dataclass(frozen=True)
class LensSettings(bounds.Settings):
    """The sensor, its calibration, and errors of its detections."""

    sensor: bounds.Part = "points"
    """The sensor: `points`, `images`, `corners` (images' rooms without the images), or one of your own."""
    image_width: bounds.PositiveInt = 320
    """[px]"""
    image_height: bounds.PositiveInt = 240
    """[px]"""
    focal_px: bounds.PositiveFloat = 195.0
    """f k_u = f k_v [px]."""
    principal_x_px: bounds.FiniteFloat = 162.0
    """u0 [px]."""
    principal_y_px: bounds.FiniteFloat = 125.0
    """v0 [px]."""
    distortion: bounds.FiniteFloat = 1.8e-5
    """K_d of equation 1 [1/px^2]; negative of a pincushion."""
    true_focal_px: bounds.PositiveFloatOrNone = None
    """Focal length of the true camera, if the calibration is wrong [px]; None: ``focal_px``."""
    true_distortion: bounds.FiniteFloatOrNone = None
    """Distortion of the true camera, if the calibration is wrong [1/px^2]; None: ``distortion``."""
    minimum_depth: bounds.PositiveFloat = 0.1
    """Points nearer than this along the optical axis are not seen [m]."""
    maximum_distance: bounds.PositiveFloatOrNone = None
    """Points farther than this are not seen [m]; None: seen at any distance."""
    pixel_std: bounds.PositiveFloat = 2.0
    """Standard deviation of the measurement noise, each axis [px]."""
    missed_detection_probability: bounds.Probability = 0.0
    """Probability that a visible point yields no detection in a frame."""
    clutter_rate: bounds.ClutterRate = 0.0
    """Mean number of false detections in a frame (Poisson, uniform in the image)."""
