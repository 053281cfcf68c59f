"""Settings of the front end: which features are searched, believed, added and deleted."""

import math
from dataclasses import dataclass, replace

from activeslam_gym.kernels import Record, filled
from activeslam_gym.vision.search import SEARCH

FOCAL_PX, RATE_HZ = 195.0, 30.0  # the lens and the rate for which the settings are stated
FEATURES, FEWEST, MOST = 49, 20, 500
"""Features of a map: those of the paper, "fewer than 50", and the fewest and the most that may be asked for."""
LEAST_SIDE = 240  # pixels along an image that leave room for features


def scale_of(focal: float, side: int) -> float:
    """The power of two by which an image is reduced before it is searched: that brings its ``focal`` length [px]
    nearest to FOCAL_PX, so that templates have the same angle in images of every size. Of a narrow lens, the longer
    ``side`` of the image [px] keeps LEAST_SIDE pixels. An image whose longer side has fewer is enlarged, once."""
    halvings = min(max(0, round(math.log2(focal / FOCAL_PX))), math.floor(math.log2(side / LEAST_SIDE)))
    return 2.0 ** max(-1, halvings)


@dataclass(frozen=True)
class FrontEndSettings:
    """Settings of one front end; a frame is one image.

    Areas of ellipses are angles: they are stated for a focal length of 195 px, and `seen_through` tells them for
    another. Other pixels are those of the image that is searched, see `scale_of`.
    """

    # Search
    gate: float = 11.8  # squared Mahalanobis distance to which ellipses are searched: 3 sigma, 99.7 %
    least_score: float = 0.8  # normalised cross-correlation of a candidate
    largest_area: float = 8000.0  # larger ellipses are not searched [px^2]
    most_change: float = 2.0  # a feature whose view has changed more is not searched, and may get a neighbour [rad]
    vague_area: float = 3000.0  # where the median ellipse is larger, scouts are searched first [px^2]
    scouts: int = 10  # how many go first
    searched: int = 40  # most features that follow, those that tell most together
    scout_area: float = 40000.0  # of a larger ellipse, a scout searches the middle part of this size [px^2]

    # Noise and association
    least_share: float = 0.2  # if fewer of the searched belong together, none is believed: outliers agree now and then
    scout_share: float = 0.4  # the same of the scouts
    match_score: float = 0.8  # score at which a match and an outlier are equally likely
    score_weight: float = 25.0  # growth of the log likelihood ratio with the score
    floor_std: float = 0.2  # pixel noise of a perfect template: lens and plane, correlated in time [px]
    grain: float = 10.0  # inflation of the covariance of the sub-pixel fit
    fiducial_std: float = 0.3  # `floor_std` of a fiducial, whose template is drawn [px]
    fiducial_grain: float = 10.0  # `grain` of a fiducial
    fiducial_blur: float = 0.003  # its deviation for each pixel a second that it moves: blur shifts a corner [s]
    fiducial_bias_std: float = 0.0  # error of a fiducial's pixel that stays until its template is drawn again [px]
    feature_bias_std: float = 0.0  # its point may be so far from the one that its template follows, see `FrontEnd` [px]
    probation: float = 5.0  # of a feature that is not yet judged the deviation is so many times larger; with a target
    lens_std: float = 0.5  # error of the lens model at half the image's width, growing with the radius squared [px]
    drift: float = 0.0  # deviation by which a feature's pixel wanders while its view changes by a radian [px]
    residual_weight: float = 3.0  # deviation of a feature's pixel for each pixel of its mean residual
    slope_std: float = 0.7  # of the two slopes of a feature's plane, which faces the camera at first
    tilt_every: float = 0.05  # the slopes are learnt from views that differ by so much [rad]
    redrawn: tuple[float, float] = (0.4, math.inf)  # change of view, and turn, after which the target is drawn [rad]

    # New features
    visible: int = 32  # features wanted in view
    births: int = 4  # most initialisations of a frame
    births_every: int = 3  # frames between two searches for corners, unless fewer than half of the wanted are in view
    spacing: float = 13.0  # distance of an initialisation from other features [px]
    least_corner: float = 4e-4  # least corner strength of an initialisation
    least_ratio: float = 0.0  # least ratio of its gradients' eigenvalues: along an edge, features slide
    depth_prior: float = 4.0  # mapped features that outweigh the scenario's inverse depth of a new one; inf: none does
    least_depth_spread: float = 1.5  # deviation of that inverse depth, at least so many times its mean
    depth_in_common: float = 0.5  # share of its variance that is common to the new features of an image; with a target
    most_vague: int = FEATURES  # so many of unknown depth are a full map, too: they take the filter the most time
    room_below: int = 32  # in a full map, features not seen for longest are deleted while fewer are in view

    # Deletion: a feature is judged by its running record
    trials: int = 10  # after so many searches it is judged ...
    least_success: float = 0.5  # ... and deleted where a smaller share of them was matched
    most_residual: float = 1.0  # deleted where its pixels are that far from the updated estimate, in the mean [px]
    odd_residual: float = 0.3  # and where so far, and four times as far as the median feature: it slides along an edge
    most_strain: float = 0.12  # deleted where the halves of its template move that differently, as at an edge [px]
    strain_of_tilt: float = 0.03  # and as much more as the halves of a tilted plane may, for each pixel of parallax
    memory: float = 0.9  # share of the record that is left after one more search
    clear: float = 0.5  # a frame in which a smaller share is matched is blurred: no feature is judged or initialised
    least_clear: int = 3  # and so is one in which fewer are matched

    # Recovery
    lost_after: int = 3  # frames in a row in which next to nothing is found, until the map is sought in the whole image
    regained: int = 7  # fewer matches do not end that: in the wide ellipses of a lost camera, three agree by chance
    patience: int = 20  # such frames until features are judged and initialised again in any case
    sought: int = 20  # features that are sought, those with the best record
    constellation: int = 7  # so many must agree with one pose

    def seen_through(self, focal: float) -> "FrontEndSettings":
        """The same, with areas of the same angles in a lens of ``focal`` length [px]."""
        share = (focal / FOCAL_PX) ** 2
        areas = {name: share * getattr(self, name) for name in ("largest_area", "vague_area", "scout_area")}
        return replace(self, **areas)

    def at_rate(self, rate: float) -> "FrontEndSettings":
        """The same, for ``rate`` [Hz] images a second: times in frames are stated for 30 Hz."""
        return replace(self, births_every=max(1, round(self.births_every * rate / RATE_HZ)))

    def search(self, scouting: bool) -> Record:
        """The SEARCH record; scouts search the middle of ellipses that are too large."""
        return filled(SEARCH, self, largest_area=self.scout_area if scouting else self.largest_area, shrink=scouting)


SIGHTED = FrontEndSettings(
    depth_prior=math.inf, visible=16, births=3, room_below=8, least_clear=0, clear=0.0, lens_std=0.0, floor_std=0.015,
    grain=1.5, drift=0.6, fiducial_std=0.025, fiducial_grain=7.0, fiducial_blur=0.001, fiducial_bias_std=0.025,
    feature_bias_std=0.2, residual_weight=12.0, most_change=0.7, least_score=0.87, most_residual=0.12, most_strain=0.07,
    least_ratio=0.22, largest_area=4000.0, vague_area=1500.0, scout_area=20000.0, searched=100, most_vague=10**6,
    probation=1.0, regained=3, redrawn=(0.1, 0.1), depth_in_common=0.0,
)  # fmt: skip
"""The front end of a camera whose lens is known, in a room whose map should hold all of it."""
