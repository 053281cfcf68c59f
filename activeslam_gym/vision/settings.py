"""Settings of the front end: which features are searched, believed, added and deleted."""

import math
from dataclasses import dataclass, replace

FOCAL_PX = 195.0  # the lens for which the settings are stated
FEATURES, TRACK_FEATURES, FEWEST, MOST = 49, 200, 20, 500
"""Features of a map: those of the paper, "fewer than 50", those of `track`, the fewest and the most that are allowed.

With a target, of 10 videos of a minute through rooms 4 were wrong in silence with 49, 2 with 100, none from 150 on."""
RATE = 30.0  # images a second of a camera, up to which numbers of images are stated; of more, each counts less
ENOUGH = 1.0 - 1.0 / math.e  # of the limit of a feature's running record, from which it is judged
LEAST_SIDE = 240  # pixels along an image that leave room for features


def weight_of_image(frame_time: float) -> float:
    """What an image counts for, where they are ``frame_time`` [s] apart: one, up to 30 images a second."""
    return min(1.0, RATE * frame_time)


@dataclass(frozen=True)
class FrontEndSettings:
    """Settings of one front end; a frame is one image.

    The area of an ellipse is an angle: it is stated for a focal length of 195 px, and `seen_through` tells it for
    another. Other pixels are those of the image that is searched, see `Calibration.scale`.
    """

    readout: float = 0.0  # time from the first row of an image to the last, of a rolling shutter [s]

    # Search
    least_score: float = 0.8  # normalised cross-correlation of a candidate; a match and an outlier are as likely there
    largest_area: float = 20000.0  # of a larger ellipse, the middle part of this size is searched [px^2]
    most_change: float = 2.0  # a feature whose view has changed more is not searched, and may get a neighbour [rad]

    # Noise and association
    score_weight: float = 25.0  # growth of the log likelihood ratio with the score
    floor_std: float = 0.25  # pixel noise of a perfect template: lens and plane, correlated in time [px]
    lasting_std: float = 0.0  # error of a template that is the same in all images of a view; adds up over them [px]
    grain: float = 10.0  # inflation of the covariance of the sub-pixel fit
    fiducial_std: float = 0.3  # `floor_std` of a fiducial, whose template is drawn [px]
    blur: float = (
        0.003  # deviation for each pixel a second, of fiducials; without them of features, along their way [s]
    )
    fiducial_bias_std: float = 0.0  # error of a fiducial's pixel that stays until its template is drawn again [px]
    fitted_every: float = math.inf  # change of view after which the plane of a feature is fitted again [rad]
    target_reach: float = 60.0  # so far around its corners a target is sought that is missed where it is in view [px]
    redrawn: float = 0.4  # change of view, or turn, after which the target is drawn again [rad]
    feature_bias_std: float = 0.0  # its point may be so far from the one that its template follows, see `FrontEnd` [px]
    probation: float = 5.0  # of a feature that is not yet judged the deviation is so many times larger; with a target
    lens_std: float = 0.5  # error of the lens model at half the image's width, growing with the radius squared [px]
    drift: float = 0.0  # deviation by which a feature's pixel wanders while its view changes by a radian [px]
    residual_weight: float = 3.0  # deviation of a feature's pixel for each pixel of its mean residual

    # New features
    visible: int = 32  # features wanted in view; an eighth is initialised in a frame, where so many are missing
    least_visible: int = 32  # in a full map, features not seen for longest make room while fewer are in view
    least_corner: float = 4e-4  # least corner strength of an initialisation
    depth_prior: float = 4.0  # mapped features that outweigh the scenario's inverse depth of a new one; inf: none does
    least_depth_spread: float = 1.5  # deviation of that inverse depth, at least so many times its mean

    # Deletion: a feature is judged by its running record
    trials: int = 10  # searches over which the record is a mean; deleted after as many, of which half are missed
    most_residual: float = 0.3  # and where its pixels are that far from the updated estimate in the mean, [px]
    # and four times as far as those of the median feature: it slides along an edge

    # Recovery
    lost_after: int = 3  # frames in a row in which next to nothing is found, until the map is sought in the whole image
    constellation: int = 7  # so many must agree with one pose

    @property
    def initialised(self) -> int:
        """Most initialisations of a frame; corners are sought where so many features are missing."""
        return self.visible // 8

    def seen_through(self, focal: float) -> "FrontEndSettings":
        """The same, with an area of the same angle in a lens of ``focal`` length [px]."""
        return replace(self, largest_area=self.largest_area * (focal / FOCAL_PX) ** 2)

    def timed(self, frame_time: float) -> "FrontEndSettings":
        """The same, with ``trials`` of the same time for a camera whose images are ``frame_time`` [s] apart."""
        return replace(self, trials=round(self.trials / weight_of_image(frame_time)))


SIGHTED = FrontEndSettings(
    depth_prior=math.inf, visible=24, least_visible=8, lens_std=0.0, floor_std=0.015, lasting_std=0.02, grain=1.5,
    fiducial_std=0.025, drift=0.6, blur=0.001, fiducial_bias_std=0.025, redrawn=0.1, feature_bias_std=0.2,
    target_reach=0.0, residual_weight=12.0, most_change=0.7, least_score=0.87, most_residual=0.12, fitted_every=0.05,
)  # fmt: skip
"""The front end of a camera whose lens is known, in a room whose map should hold all of it."""
