"""The iterated correction, and the noise of what its line leaves out: by what they must obey."""

import numpy as np
import pytest

from activeslam_gym.camera import View
from activeslam_gym.config import Scenario
from activeslam_gym.slam.belief import INVERSE_DEPTH, POINT, RHO
from activeslam_gym.slam.filter import Filter, detections_of
from activeslam_gym.slam.kalman import correct
from activeslam_gym.slam.sight import predict_pixel, sight_with
from tests import support
from tests.support import CAMERA, NO_FIDUCIALS, PAPER, copied, joint_covariance, pixel_of, random_belief, sight_of

SEEDS = pytest.mark.parametrize("seed", range(12))


def test_where_the_measurement_is_straight_the_correction_is_the_update() -> None:
    rng = np.random.default_rng(3)
    belief = random_belief(PAPER, [POINT, INVERSE_DEPTH, POINT], rng)
    belief.covariance[:] *= 1e-4
    once, sight = copied(belief), sight_of(belief)
    nu = 0.1 * rng.standard_normal(len(sight.S))
    assert support.update(once, sight.HP.copy(), sight.S.copy(), nu.copy())
    z = sight.point["z_hat"].ravel() + nu
    assert correct(CAMERA, belief, NO_FIDUCIALS, sight._replace(point=sight.point.copy()), z)
    np.testing.assert_allclose(support.mean_difference(belief, once), 0.0, atol=1e-14)
    np.testing.assert_allclose(joint_covariance(belief), joint_covariance(once), rtol=1e-12, atol=1e-18)


@SEEDS
def test_a_large_correction_ends_where_the_pixels_are(seed: int) -> None:
    """Points known to be somewhere near, seen without noise: the iterated mean explains them, one update does not."""
    rng = np.random.default_rng(seed)
    camera = support.random_camera(rng)
    fiducials = support.world_points(rng, camera, 8, (1.0, 2.5))
    belief = random_belief(PAPER, [], rng, camera)
    belief.covariance[:12, :12] = np.diag([0.3**2] * 3 + [0.2**2] * 3 + [1e-6] * 6)
    offset = np.concatenate((rng.choice([-0.2, 0.2], 3), rng.choice([-0.12, 0.12], 3), np.zeros(6)))
    true = support.moved(camera, offset)
    z = np.array([pixel_of(CAMERA, true, y) for y in fiducials]).ravel()
    points, once = sight_of(belief, fiducials).point, copied(belief)
    sight = sight_with(points, belief.covariance, belief.state.dim)
    assert len(points) == 8
    support.update(once, sight.HP.copy(), sight.S.copy(), z - sight.point["z_hat"].ravel())
    assert correct(CAMERA, belief, fiducials, sight, z)
    errors = [np.linalg.norm(one.state.camera[:3] - true[:3]) for one in (belief, once)]
    assert errors[0] < 0.02 and errors[0] < 0.5 * errors[1]
    P = joint_covariance(belief)
    assert np.linalg.eigvalsh(P).min() > 0.0
    np.testing.assert_array_equal(P, P.T)


def test_a_correction_without_a_factor_changes_nothing() -> None:
    belief = random_belief(PAPER, [POINT], np.random.default_rng(0))
    before, sight = copied(belief), sight_of(belief)
    sight.S[:] = -np.eye(2)
    assert not correct(CAMERA, belief, NO_FIDUCIALS, sight, np.ones(2))
    np.testing.assert_array_equal(belief.covariance, before.covariance)
    assert belief.state == before.state and (belief.feature == before.feature).all()


def test_what_the_line_leaves_out_is_in_the_noise() -> None:
    """A vague inverse depth and a vague position across the sight: the residual's variance over 20 000 draws."""
    rng = np.random.default_rng(0)
    belief = random_belief(PAPER, [INVERSE_DEPTH], rng)
    belief.state.camera[:7] = (0, 0, 0, 1, 0, 0, 0)
    feature = belief.feature[0]
    feature.mean[:] = (0.0, 0, 0, 0, 0, 0.5)
    stds, rho = np.array([0.05, 0.15]), feature.start + RHO
    correlated = np.outer(stds, stds) * [[1.0, 0.5], [0.5, 1.0]]
    belief.covariance[:] = 1e-12 * np.eye(len(belief.covariance))
    belief.covariance[np.ix_([0, rho], [0, rho])] = correlated
    point = sight_of(belief).point[:1].copy()
    H, said, left = point["H_camera"][0, 0, 0], point["z_hat"][0, 0], []
    for x, d_rho in rng.multivariate_normal([0.0, 0.0], correlated, 20_000):
        belief.state.camera[0], feature.mean[RHO] = x, max(0.5 + d_rho, 0.01)
        assert predict_pixel(
            View(CAMERA, belief.state.camera, np.eye(3), support.NO_BOXES), belief, NO_FIDUCIALS, point[0]
        )
        left.append(point["z_hat"][0, 0] - said - H * x)
    assert np.var(left) == pytest.approx(point["curvature"][0, 0, 0], rel=0.1)
    assert point["curvature"][0, 0, 0] > 2.0


@pytest.mark.parametrize(("command_known", "low", "high"), [(True, 0.0, 2.0), (False, 3.0, np.inf)])
def test_a_product_of_errors_that_lasts_is_counted_once(command_known: bool, low: float, high: float) -> None:
    """Counted again in each frame, it makes the filter overconfident of a way and a depth: it saw their product alone.

    The mean NEES of the position of a camera of unknown speed across the sight of a new point, after a second.
    """
    squares, rng = [], np.random.default_rng(0)
    scenario = Scenario(acceleration_std=1e-3, angular_acceleration_std=1e-3, command_known=command_known)
    prior = np.diag([1e-8] * 6 + [0.15**2, 1e-8, 1e-8] + [1e-8] * 3)
    for _ in range(60):
        speed, rho = 0.15 * rng.standard_normal(), max(0.5 + 0.3 * rng.standard_normal(), 0.1)
        filter = Filter(scenario, covariance=prior)
        truth = filter.mean
        point = np.array([0.0, 0.0, 1.0 / rho])
        id = filter.add_landmark(pixel_of(CAMERA, truth, point))
        for _ in range(20):
            truth[0] += 0.05 * speed
            filter.predict()
            seen = pixel_of(CAMERA, truth, point) + 2.0 * rng.standard_normal(2)
            filter.update(detections_of(seen[None], ids=np.array([id])), labelled=True)
        squares.append((truth[0] - filter.mean[0]) ** 2 / filter.belief.covariance[0, 0])
    assert low < np.mean(squares) < high


@SEEDS
def test_a_correction_of_a_metre_and_a_radian_leaves_a_belief(seed: int) -> None:
    """Pixels up to 150 px away from what so vague a camera predicts, of which some can have no common cause."""
    rng = np.random.default_rng(seed)
    camera = support.random_camera(rng)
    fiducials = support.world_points(rng, camera, 6, (1.0, 2.5))
    belief = random_belief(PAPER, [], rng, camera)
    belief.covariance[:12, :12] = np.diag([1.0**2] * 3 + [0.6**2] * 3 + [1e-6] * 6)
    sight = sight_of(belief, fiducials)
    z = sight.point["z_hat"].ravel() + rng.uniform(-150.0, 150.0, 2 * len(sight.point))
    assert correct(CAMERA, belief, fiducials, sight, z)
    P = joint_covariance(belief)
    assert np.isfinite(belief.state.camera).all() and np.linalg.eigvalsh(P).min() > 0.0
