"""Unknown correspondence: joint, unambiguous matches inside chi-square gates.

The paper gives each measurement to the nearest predicted feature inside its ellipse, alone. That is where single runs
go wrong (fiducials swapped under the prior's wide ellipses, a wrong landmark taken on re-entry after a full turn), and
one wrong match makes the next ones. So a match must be more than near:

1. "Near" is by likelihood, cost = d^2 + ln |S|: plain Mahalanobis distance favours whatever is uncertain.
2. A sharply predicted row is matched if it and the detection are each other's best and no rival inside the
   initialisation gate comes within a margin. The joint Gaussian of the other predicted pixels is then conditioned on
   it, which sharpens them too (sequential compatibility nearest neighbour, with the compatibility test that Neira and
   Tardos, "Data association in stochastic mapping using the joint compatibility test", 2001, ask for). Near the border
   of the image it must also be clear that the prediction is not just outside.
3. What is left is matched jointly, as a constellation (see `constellation`): that closes loops, and finds the way back
   where wide ellipses are ambiguous one by one. What was seen lately needs less of a lead than what comes back after a
   long time. A detection that is better explained by nothing known is new.
4. Everything else waits for a clearer frame: it gives no initialisation, and it is no miss.
5. Two predictions side by side wait too, however clear their matches seem. Between them the noise decides, and
   to match whenever it pulls them apart would make them drift apart in the map, until one is taken for the other.
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants, record
from activeslam_gym.slam.belief import KIND_DIM, POINT
from activeslam_gym.slam.constellation import Margins, log_missed, match_jointly, worth_of_pair
from activeslam_gym.slam.hypotheses import Hypotheses, accept, measure_distances, predicted_pixels
from activeslam_gym.slam.sight import INSIDE, Sight

DETECTION = record(
    pixel=("f8", 2),  # [px]
    R=("f8", (2, 2)),  # covariance of its noise [px^2]
    id="i8",  # of the one prediction that it may be; ANYTHING: any
    log_ratio="f8",  # log likelihood of its appearance, if it is that prediction, over an unmapped detection's
    match="i8",  # the filter's answer: the id of the prediction that it was matched to, or NEW or REJECTED
)
"""A measured pixel before its association. The ids are those of features (positive) and of fiducials (negative)."""
ANYTHING = 0
NEW, REJECTED = 0, -(2**62)
"""A detection that nothing known explains; one that something may explain, too unclear to be used."""


def chi_square_2_quantile(probability: float) -> float:
    """Quantile of the chi-square distribution of 2 dof, -2 ln(1 - p): 9.21 at 99 %."""
    return -2.0 * math.log(1.0 - probability)


ASSOCIATION, association_of = constants(
    Scenario(),
    gate=lambda s: chi_square_2_quantile(s.gate_probability),  # chi-square bound of a match
    birth_gate=lambda s: chi_square_2_quantile(s.birth_gate_probability),  # and of what is near a prediction
    pixel_var=lambda s: s.pixel_std**2,  # R of a detection that is still to come, each axis [px^2]
    # a predicted ellipse, without R, is sharp when its longest axis squared is at most this [px^2]:
    sharp_var=lambda s: 3.0 * s.pixel_std**2,
    clear_margin=20.0,  # lead over its rivals that a match of a sharp row needs, in -2 ln of the likelihood
    border_margin=6.0,  # and, near the border of the image, its lead over the prediction's being outside, in ln
    margin=8.0,  # lead over both that a joint match needs, in ln
    lately=lambda s: round(10.0 / s.frame_time),  # a feature matched within so many frames was seen lately
    just_now=lambda s: round(0.25 / s.frame_time),  # and within so many, just now
    missed_margin=6.0,  # of a feature seen lately: the lead over its not being detected, in ln
    point_margin=5.0,  # of a point seen lately, not just now: the lead over its being another detection
    point_missed_margin=3.0,  # and over its not being detected
    twin_px=lambda s: 4.0 * s.pixel_std,  # predictions nearer to each other are ambiguous [px]
    novelty=2.0,  # lead of "it is of nothing known" that makes a detection NEW, in ln
    nodes=400,  # of a joint search
    detection_probability="f8",  # of what is in the image
    # -2 ln of the density of one unmapped detection in an image, less that of 2 pi:
    clutter_cost=lambda s: 2.0 * math.log(s.image_width * s.image_height / (2.0 * math.pi)),
    landmarks=lambda s: float(s.landmark_count),  # that the room holds
    clutter_rate="f8",  # false detections in an image
    width=lambda s: float(s.image_width),  # of the image [px]
    height=lambda s: float(s.image_height),
)
"""Constants of the association."""


@compiled
def associate(
    model: Record, sight: Sight, detections: np.ndarray, features: int, waits: np.ndarray
) -> tuple[np.ndarray, int]:
    """Match ``detections`` (M,) to the predictions in ``sight`` (v,) of a map with so many ``features``.

    Returns (v,) the detection of each prediction, or -1, with the number of joint matches, and sets
    ``detections.match``. ``waits`` (v,) bool is set for the predictions that a detection may be of without being clear
    enough to match.
    """
    h, v, M = _open_questions(model, sight, detections), sight.thing.shape[0], detections.shape[0]
    of_thing, novelty, jointly = np.full(v, -1), np.zeros(M), 0
    pair_worth, margins = worth_of_pair(model, expected_unmapped(model, features)), _margins(model, sight.thing)
    settled = False  # what a search of everything leaves open stays so
    while _any_open(model, h):
        if not _match_clear(model, h, sight.thing, detections, pair_worth, of_thing):
            if settled:
                break
            matched, settled = match_jointly(model, h, detections, pair_worth, margins, of_thing, novelty)
            jointly += matched
            settled = settled or matched == 0
    for i in range(M):
        detections[i].match = NEW
        for a in range(v):
            if h.free[i] and h.d2[a, i] < model.birth_gate and novelty[i] < model.novelty:
                detections[i].match = REJECTED
                waits[a] |= h.open[a]
    for a in range(v):
        if of_thing[a] >= 0:
            detections[of_thing[a]].match = sight.thing[a].id
    taken_back = 0
    for a in range(v):
        if _has_twin(model, sight.thing, a):
            taken_back += _take_back(detections, of_thing, waits, a)
    return of_thing, max(jointly - taken_back, 0)


@compiled
def _open_questions(model: Record, sight: Sight, detections: np.ndarray) -> Hypotheses:
    """All predictions open, all detections free: which may be which, and by what distance."""
    v, M = sight.thing.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    h = Hypotheses(
        z,
        S,
        np.ones(v, np.bool_),
        np.ones(M, np.bool_),
        np.empty((v, M), np.bool_),
        np.full((v, M), np.inf),
        np.full((v, M), np.inf),
    )
    for a in range(v):
        for i in range(M):
            h.allowed[a, i] = detections[i].id == ANYTHING or detections[i].id == sight.thing[a].id
    measure_distances(h, detections)
    return h


@compiled
def _margins(model: Record, things: np.ndarray) -> Margins:
    """The leads that joint matches of ``things`` (v,) need.

    That what was seen lately is not detected, and something new is in its place, is rarer than the search believes, to
    which every frame is a new one. Less so of a point seen just now: its ellipse is sharp, and where the lead is low,
    the residual is large. What comes back after a long time does so beside landmarks of which nothing is known, by a
    pose that has drifted.
    """
    margins = Margins(np.full(things.shape[0], model.margin), np.full(things.shape[0], model.margin))
    for a in range(things.shape[0]):
        thing = things[a]
        if thing.id < 0 or thing.unseen > model.lately:
            continue
        margins.missed[a] = model.missed_margin
        if thing.width == KIND_DIM[POINT] and thing.unseen > model.just_now:
            margins.other[a], margins.missed[a] = model.point_margin, model.point_missed_margin
    return margins


@borrowing
def _take_back(detections: np.ndarray, of_thing: np.ndarray, waits: np.ndarray, a: int) -> int:
    """Take back the match of prediction ``a`` by a detection that may be anything; the number of matches taken back."""
    i = of_thing[a]
    if i < 0 or detections[i].id != ANYTHING:
        return 0
    detections[i].match, of_thing[a], waits[a] = REJECTED, -1, True
    return 1


@borrowing
def _has_twin(model: Record, things: np.ndarray, a: int) -> bool:
    """Whether another of the ``things`` (v,) is predicted beside prediction ``a``.

    Two that are d apart are told apart by (d / s)^2 +- sqrt(2) d / s nats, s the deviation of a pixel: at d = 4 s by
    16 +- 6, so that hardly a match that is clear enough owes it to its noise.
    """
    z = things[a].z_hat
    for b in range(things.shape[0]):
        other = things[b].z_hat
        if b != a and (z[0] - other[0]) ** 2 + (z[1] - other[1]) ** 2 < model.twin_px**2:
            return True
    return False


@borrowing
def _longest_square(S: np.ndarray, a: int) -> float:
    """Square of the longest axis of prediction ``a``'s ellipse in the joint ``S`` (2 v, 2 v)."""
    s00, s01, s11 = S[2 * a, 2 * a], S[2 * a, 2 * a + 1], S[2 * a + 1, 2 * a + 1]
    half = 0.5 * (s00 + s11)
    return half + math.sqrt(max(half * half - (s00 * s11 - s01 * s01), 0.0))


@compiled
def expected_unmapped(model: Record, features: int) -> float:
    """Detections of nothing known that are expected in an image, of landmarks that are still owed and of clutter.

    An image sees about 15 % of a room; some landmarks may be owed although there is a feature for each.
    """
    return max(0.15 * (model.landmarks + 3.0 - features), 0.3) + model.clutter_rate


@borrowing
def _any_open(model: Record, h: Hypotheses) -> bool:
    """Whether an open prediction and a free detection may still belong together."""
    for a in range(h.open.shape[0]):
        if h.open[a]:
            for i in range(h.free.shape[0]):
                if h.free[i] and h.d2[a, i] < model.birth_gate:
                    return True
    return False


@compiled
def _match_clear(
    model: Record, h: Hypotheses, things: np.ndarray, detections: np.ndarray, pair_worth: float, of_thing: np.ndarray
) -> bool:
    """Match every sharp prediction that has a clear partner, and condition the rest on them; whether there was any.

    Near the border a prediction may just be outside, and an unmapped detection beside it: there the match has to lead
    that, too. A pair's likelihood is ``pair_worth`` less half of its cost.
    """
    v, found = h.open.shape[0], False
    partner = np.full(v, -1)
    for a in range(v):
        if h.open[a] and _longest_square(h.S, a) <= model.sharp_var:
            partner[a] = _clear_partner(model, h, a)
            if partner[a] >= 0 and things[a].visibility != INSIDE:
                lead = pair_worth - 0.5 * h.cost[a, partner[a]] - log_missed(model, h, a)
                partner[a] = partner[a] if lead >= model.border_margin else -1
            found |= partner[a] >= 0
    for a in range(v):
        if partner[a] >= 0:
            of_thing[a] = partner[a]
            accept(h, a, partner[a], detections)
    if found:
        measure_distances(h, detections)
    return found


@borrowing
def _clear_partner(model: Record, h: Hypotheses, a: int) -> int:
    """The free detection that is the best of prediction ``a`` by a margin, as ``a`` is of the detection; or -1."""
    best = -1
    for i in range(h.free.shape[0]):
        if h.free[i] and h.d2[a, i] < model.gate and (best < 0 or h.cost[a, i] < h.cost[a, best]):
            best = i
    if best < 0:
        return -1
    bound = h.cost[a, best] + model.clear_margin
    for i in range(h.free.shape[0]):
        if i != best and h.free[i] and h.d2[a, i] < model.birth_gate and h.cost[a, i] < bound:
            return -1
    for r in range(h.open.shape[0]):
        if r != a and h.open[r] and h.d2[r, best] < model.birth_gate and h.cost[r, best] < bound:
            return -1
    return best
