"""The picture of a snapshot: its shape, that it shows what changes, and that nothing degenerate breaks it."""

import sys
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("matplotlib")

from activeslam_gym import Gaze, Motion, Scenario, rendering
from activeslam_gym.rendering import geometry, scene

SCENARIO = Scenario()


def pixels_and_visibility(points, position, quaternion):
    """Pinhole pixels (n, 2) of world points (n, 3), and which are in front and within 320 x 240."""
    points_C = Rotation.from_quat(quaternion, scalar_first=True).inv().apply(points - position)
    depth = np.where(points_C[:, 2] > 0.1, points_C[:, 2], np.inf)
    pixels = np.stack((162 - 195 * points_C[:, 0] / depth, 125 - 195 * points_C[:, 1] / depth), axis=1)
    inside = (points_C[:, 2] > 0.1) & (pixels > 0).all(1) & (pixels < (320, 240)).all(1)
    return pixels, inside


def random_spd(rng, count, dimension, scale):
    """Covariances (count, d, d) of random shape; `scale` (count,) is the longest standard deviation."""
    rotations = np.linalg.qr(rng.normal(size=(count, dimension, dimension)))[0]
    stds = scale[:, None] * np.sort(rng.uniform(0.15, 1.0, (count, dimension)), axis=1)
    return np.einsum("nij,nj,nkj->nik", rotations, stds**2, rotations)


def make_snapshot(seed=0, landmarks=20, steps=300, time=15.0, motion=Motion.FORWARD, gaze=Gaze.LEFT, history=True):
    """A plausible moment of an episode: a camera that turns left as it walks, some of 27 landmarks in the map."""
    rng = np.random.default_rng(seed)
    room_size = np.array([6.0, 2.0, 6.0])
    true_landmarks = rng.uniform(-0.47, 0.47, (27, 3)) * room_size
    phase = np.linspace(0.0, 1.0, steps)[:, None]
    path = np.hstack((1.1 * np.sin(4 * phase), 0.25 * np.sin(7 * phase), -1.2 + 2.3 * phase + 0.3 * np.cos(5 * phase)))
    drift = np.cumsum(rng.normal(0, 0.0015, (steps, 3)), axis=0)
    heading = 0.2 * time
    true_quaternion = Rotation.from_rotvec([0, heading, 0]).as_quat(scalar_first=True)
    quaternion = Rotation.from_rotvec([0.01, heading + 0.015, 0]).as_quat(scalar_first=True)

    mapped = np.arange(landmarks) < landmarks - 4
    scale = np.where(mapped, rng.uniform(0.05, 0.2, landmarks), rng.uniform(0.4, 0.9, landmarks))
    blocks = random_spd(rng, landmarks, 3, scale)
    covariance = np.diag(np.full(12 + 3 * landmarks, 0.05**2))
    for i, block in enumerate(blocks):
        covariance[12 + 3 * i : 15 + 3 * i, 12 + 3 * i : 15 + 3 * i] = block
    noise = np.array([rng.multivariate_normal(np.zeros(3), block) for block in blocks]).reshape(-1, 3)
    estimates = true_landmarks[:landmarks] + noise

    detections, seen = pixels_and_visibility(true_landmarks, path[-1], true_quaternion)
    predicted, expected = pixels_and_visibility(estimates, path[-1] + drift[-1], quaternion)
    times = np.linspace(0.0, time, steps) if history else np.zeros(0)
    landmark_times = np.sort(rng.uniform(0.5, time, mapped.sum())) if history else np.zeros(0)
    learned = 14 * (times[:, None] > landmark_times).sum(axis=1) if history else np.zeros(0)
    return SimpleNamespace(
        scenario=SCENARIO,
        time=time,
        duration=35.0,
        motion=motion,
        gaze=gaze,
        room_size=room_size,
        true_position=path[-1],
        true_quaternion=true_quaternion,
        true_landmarks=true_landmarks,
        fiducials=np.array([(x, y, 2.95) for x in (-0.8, 0.0, 0.8) for y in (-0.4, 0.4)]),
        position=path[-1] + drift[-1],
        quaternion=quaternion,
        covariance=covariance,
        landmarks=estimates,
        mapped=mapped,
        expected_landmarks=rng.uniform(-0.47, 0.47, (max(27 - landmarks, 0), 3)) * room_size,
        detections=detections[seen] + rng.normal(0, 2, (seen.sum(), 2)),
        predicted=predicted[expected],
        predicted_covariance=random_spd(rng, expected.sum(), 2, np.full(expected.sum(), 8.0)),
        true_trajectory=path if history else np.zeros((0, 3)),
        estimated_trajectory=path + drift if history else np.zeros((0, 3)),
        times=times,
        entropy=60.0 - learned - 2.5 * times,
        landmark_times=landmark_times,
        image=None,
        image_size=np.array([320, 240]),
    )


@pytest.mark.parametrize("size", [(960, 640), (480, 320), (333, 217), (640, 480), (1200, 700)])
def test_every_size_is_met_to_the_pixel(size):
    picture = rendering.draw(make_snapshot(), size)
    assert picture.shape == (size[1], size[0], 3) and picture.dtype == np.uint8
    assert picture.flags.writeable and picture.flags.c_contiguous
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


def test_the_size_is_960_by_640_unless_told():
    assert rendering.draw(make_snapshot()).shape == (640, 960, 3)


def test_not_blank_in_any_panel():
    picture = rendering.draw(make_snapshot()).astype(float)
    for rows, columns in (
        (slice(70, 560), slice(20, 600)),
        (slice(90, 300), slice(660, 930)),
        (slice(390, 560), slice(660, 930)),
    ):
        assert picture[rows, columns].std() > 5


def test_same_snapshot_same_picture_whatever_came_between():
    first = rendering.draw(make_snapshot(seed=1))
    kept = first.copy()  # pictures are not views of one buffer
    between = rendering.draw(make_snapshot(seed=2, landmarks=3, gaze=Gaze.STAY, history=False))
    assert not np.array_equal(between, first)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(rendering.draw(make_snapshot(seed=1)), first)


@pytest.mark.parametrize(
    "change",
    [
        {"motion": Motion.UP},
        {"gaze": Gaze.RIGHT},
        {"mapped": np.zeros(20, bool)},
        {"covariance": 0.01 * np.eye(72)},
        {"true_position": np.zeros(3)},
        {"expected_landmarks": np.zeros((0, 3))},
        {"detections": np.zeros((0, 2))},
        {"entropy": np.linspace(0, -500, 300)},
        {"landmark_times": np.zeros(0)},
        {"true_trajectory": np.zeros((0, 3))},
        {"room_size": np.array([10.0, 3.0, 8.0])},
    ],
    ids=lambda change: next(iter(change)),
)
def test_each_field_shows(change):
    snapshot = make_snapshot()
    before = rendering.draw(snapshot)
    vars(snapshot).update(change)
    assert not np.array_equal(rendering.draw(snapshot), before)


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("gaze", Gaze)
def test_command_names_motion_and_gaze(motion, gaze):
    text = scene.command_text(motion.name, gaze.name)
    assert motion.name in text and f"gaze {gaze.name}" in text


@pytest.mark.filterwarnings("error")
def test_empty_map_and_no_history():
    snapshot = make_snapshot(landmarks=0, steps=1, time=0.0, history=False)
    snapshot.expected_landmarks = snapshot.fiducials = snapshot.true_landmarks = np.zeros((0, 3))
    assert rendering.draw(snapshot).std() > 5


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("block", [np.zeros((3, 3)), np.diag([1.0, 0, 0]), -np.eye(3), np.full((3, 3), np.nan)])
def test_degenerate_covariances_do_not_raise(block):
    snapshot = make_snapshot(landmarks=5)
    snapshot.covariance[12:15, 12:15] = snapshot.covariance[:3, :3] = block
    snapshot.predicted_covariance[:] = block[:2, :2]
    assert rendering.draw(snapshot).std() > 5


@pytest.mark.filterwarnings("error")
def test_a_lost_belief_that_is_nan_still_draws_the_truth():
    snapshot = make_snapshot()
    for name in ("position", "quaternion", "covariance", "landmarks", "predicted", "predicted_covariance"):
        getattr(snapshot, name)[:] = np.nan
    snapshot.entropy[-1] = np.nan
    assert rendering.draw(snapshot).std() > 5


def test_view_is_right_handed_and_up_is_up():
    """A mirrored room would show a gaze to the LEFT turning right."""
    axes = geometry.view_axes(0.4, 0.6)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0] @ [1, 0, 0] < 0 and axes[1] @ [0, 1, 0] > 0 and axes[0] @ [0, 1, 0] == pytest.approx(0.0)


def test_ellipses_and_great_circles_lie_at_their_sigmas():
    rng = np.random.default_rng(0)
    for dimension, curves in ((2, geometry.ellipses), (3, geometry.great_circles)):
        means, covariances = rng.normal(size=(4, dimension)), random_spd(rng, 4, dimension, np.ones(4))
        points = curves(means, covariances, 2.0)
        points = points.reshape(4, -1, dimension) - means[:, None]
        mahalanobis = np.einsum("nki,nij,nkj->nk", points, np.linalg.inv(covariances), points)
        np.testing.assert_allclose(mahalanobis, 4.0)


def test_great_circles_stay_within_the_outline():
    """The outline of an ellipsoid under an orthographic view V is the ellipse of V P Vᵀ."""
    rng = np.random.default_rng(1)
    covariance = random_spd(rng, 1, 3, np.ones(1))
    outline = np.linalg.inv(geometry.VIEW @ covariance[0] @ geometry.VIEW.T)
    circles = geometry.screen_from_world(geometry.great_circles(np.zeros((1, 3)), covariance, 2.0))
    assert np.einsum("cki,ij,ckj->ck", circles, outline, circles).max() <= 4.0 + 1e-9
    drawn = geometry.ellipsoid_outlines(np.zeros((1, 3)), covariance, 2.0)
    np.testing.assert_allclose(np.einsum("cki,ij,ckj->ck", drawn, outline, drawn), 4.0)


def test_frustum_corners_project_back_to_the_image_corners():
    rng = np.random.default_rng(2)
    position, quaternion = rng.normal(size=3), np.array([0.5, -0.5, 0.1, 0.7])
    corners = geometry.camera_frustum(SCENARIO, (320, 240), position, quaternion, 0.7)[-1]
    pixels = pixels_and_visibility(corners, position, quaternion)[0]
    np.testing.assert_allclose(pixels, [(0, 0), (320, 0), (320, 240), (0, 240)], atol=1e-9)


def test_drawing_leaves_the_users_settings_and_pyplot_alone():
    import matplotlib
    import matplotlib.pyplot as pyplot

    before, figures = dict(matplotlib.rcParams), pyplot.get_fignums()
    rendering.draw(make_snapshot(), (320, 200))
    assert dict(matplotlib.rcParams) == before
    assert pyplot.get_fignums() == figures


def test_window_without_a_screen_names_the_alternative(no_screen):
    window = rendering.Window()
    with pytest.raises(gymnasium.error.Error, match="rgb_array"):
        window.show(make_snapshot())
    assert not no_screen.get_fignums()
    window.close()
    window.close()


def test_window_shows_redraws_and_closes(screen):
    window = rendering.Window()
    window.show(make_snapshot(seed=1))
    window.show(make_snapshot(seed=2))
    assert len(screen.get_fignums()) == 1
    screen.close("all")  # the user's click
    window.show(make_snapshot(seed=3))
    assert not screen.get_fignums()
    window.close()
    window.close()
    window.show(make_snapshot(seed=3))
    assert len(screen.get_fignums()) == 1
    window.close()
    assert not screen.get_fignums()


def test_without_matplotlib_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for render in (
        lambda: rendering.draw(make_snapshot(), (111, 77)),
        lambda: rendering.Window().show(make_snapshot()),
    ):
        with pytest.raises(gymnasium.error.DependencyNotInstalled, match=r'pip install "activeslam-gym\[plot\]"'):
            render()
