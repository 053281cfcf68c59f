"""What the front end searches, believes, adds and drops."""

from __future__ import annotations

import math
from dataclasses import dataclass

from activeslam_gym.kernels import Record, filled
from activeslam_gym.vision.search import SEARCH


@dataclass(frozen=True)
class FrontEndSettings:
    """What is searched, believed, added and dropped."""

    gate: float = 11.8
    """Ellipses are searched to this squared Mahalanobis distance: 3 sigma, 99.7 % [-]."""
    least_score: float = 0.8
    """Least normalised cross-correlation of a candidate."""
    largest_area: float = 4000.0
    """Larger ellipses are not searched [px]."""
    vague_area: float = 1500.0
    """If the median ellipse is larger, scouts are searched first [px]."""
    scout_area: float = 20000.0
    """Of a larger ellipse, a scout searches the middle part of this size [px]."""
    least_share: float = 0.2
    """If a smaller share of the searched belongs together, nothing is believed: strangers agree now and then."""
    scout_share: float = 0.4
    """The same of the scouts."""
    scouts: int = 10
    """How many go first."""
    floor_std: float = 0.3
    """Pixel noise of a perfect template: what lens and plane leave unexplained, correlated in time [px]."""
    grain: float = 10.0
    """Inflation of the covariance of the sub-pixel fit."""
    fiducial_std: float = 0.3
    """`floor_std` of a fiducial, whose template is drawn [px]."""
    fiducial_grain: float = 10.0
    """`grain` of a fiducial."""
    looks: float = math.inf
    """All images from one drawing of the target to the next together tell of its corners what so many would, if their
    errors were not the same: a stare repeats them."""
    drift: float = 0.0
    """How far a feature's pixel wanders while its view changes by a radian; its square grows with the change [px]."""
    redrawn: float = 0.1
    """The target is drawn anew when its view has changed by so much, or the camera has turned by it [rad]."""
    lens_std: float = 1.0
    """What the lens model leaves at half the image's width from the centre, growing with the radius squared [px]."""
    most_change: float = 2.0
    """A feature that is seen more differently than that is not searched, and may have a younger one beside it [rad]."""
    warp: bool = True
    """Whether templates are warped to the present view."""
    subpixel: bool = True
    """Whether matches are refined below the pixel."""
    appearance: bool = True
    """Whether the score of a match counts in the association."""
    match_score: float = 0.8
    """Score at which a match and a stranger are equally likely."""
    score_weight: float = 25.0
    """Growth of the log likelihood ratio with the score."""
    visible: int = 32
    """Features wanted in view."""
    births: int = 4
    """Most births of a frame."""
    births_every: int = 3
    """Frames from one look for corners to the next, unless fewer than half of the wanted are in view."""
    spacing: float = 13.0
    """Distance of a birth from other features [px]."""
    least_corner: float = 4e-4
    """Least corner strength of a birth."""
    least_ratio: float = 0.0
    """Least quotient of the two eigenvalues of a birth's gradients: less is an edge, along which a feature slides."""
    trials: int = 10
    """A feature is judged after so many searches ..."""
    least_success: float = 0.5
    """... and deleted when a smaller share of them was matched."""
    most_residual: float = 1.0
    """A feature whose pixels are that far, on average, from where the updated belief has it, is deleted: an edge before
    something far behind, or a moving picture [px]."""
    memory: float = 0.9
    """Share of a feature's record that is left after one more search."""
    clear: float = 0.5
    """A frame in which a smaller share of the searched is matched is blurred: it judges no feature and bears none."""
    least_clear: int = 3
    """So is one in which fewer are matched."""
    room_below: int = 32
    """In a full map, features not seen for longest make room while fewer are in view."""
    recover: bool = True
    """Whether ``least_share`` is demanded, scouts go first where ellipses are large, and a lost map is sought."""
    lost_after: int = 3
    """Images, one after the other, in which next to nothing that should be there is found, until the map is lost and is
    sought in the whole image."""
    patience: int = 20
    """Such images until features are judged and born again, come what may."""
    sought: int = 20
    """Features that are sought, those with the best record."""
    constellation: int = 7
    """So many must be where one pose has them."""

    def search(self, scouting: bool) -> Record:
        """The SEARCH record; scouts look into the middle of ellipses that are too large."""
        return filled(
            SEARCH,
            gate=self.gate,
            least_score=self.least_score,
            largest_area=self.scout_area if scouting else self.largest_area,
            shrink=scouting,
            floor_std=self.floor_std,
            grain=self.grain,
            warp=self.warp,
            subpixel=self.subpixel,
        )


SIGHTED = FrontEndSettings(
    visible=16, births=3, room_below=8, least_clear=0, clear=0.0, lens_std=0.0, floor_std=0.05, grain=25.0, drift=0.6,
    fiducial_std=0.025, fiducial_grain=7.0, looks=28.0, most_change=0.7, least_score=0.87, most_residual=0.22,
    least_ratio=0.22,
)  # fmt: skip
"""The front end of a camera whose lens is known, in a room whose map should hold all of it."""
