"""A loose upper bound: a camera on the path of a run, with a known pose, that sees every landmark in every frame."""

import math

import numpy as np

from activeslam_gym import Scenario
from activeslam_gym.evaluation import Episode

LOG2_2PIE = math.log2(2.0 * math.pi * math.e)


def ceiling(episode: Episode, scenario: Scenario) -> float:
    """Expected log score [bit] of a camera on the path of `episode` that sees all landmarks in every frame.

    A bearing from p to y has the information (f / (sigma d))^2 (I - m m^T) of y, d = |y - p|, m = (y - p) / d: that of
    a pixel at the image's centre, where the lens is sharpest. Summed over the frames it is Lambda, and the expected
    log2 density of the landmark 1/2 log2 |Lambda| - 3/2 log2(2 pi e), of which the prior's is subtracted. The camera's
    own part is that of the run.
    """
    variance = np.array(scenario.landmark_prior_variance)
    sight = episode.true_landmarks[:, None] - episode.true_position[1:]  # (L, T - 1, 3)
    distance = np.maximum(np.linalg.norm(sight, axis=-1), scenario.minimum_depth)
    m = sight / distance[..., None]
    frames = np.diff(episode.times) / scenario.frame_time
    weight = frames * (scenario.focal_px / (scenario.pixel_std * distance)) ** 2
    across = np.eye(3) - m[..., :, None] * m[..., None, :]
    information = np.diag(1.0 / variance) + np.einsum("lt,ltij->lij", weight, across)
    density = 0.5 * np.linalg.slogdet(information)[1] / math.log(2.0) - 1.5 * LOG2_2PIE
    exponents = np.log(2.0 * math.pi * variance) + episode.true_landmarks**2 / variance
    prior_density = -0.5 * exponents.sum(axis=1) / math.log(2.0)
    camera = 0.5 * (episode.log2_det_camera[0] - episode.log2_det_camera[-1])
    return float(np.sum(density - prior_density) + camera)
