"""The picture of a snapshot: its shape, that it shows what changes, and that nothing degenerate breaks it."""

import copy
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pyplot = pytest.importorskip("matplotlib.pyplot")

from matplotlib.backend_bases import FigureManagerBase

from activeslam_gym import Gaze, Motion, Scenario
from activeslam_gym.rendering import picture as rendering
from activeslam_gym.rendering import scene
from tests.support import random_spd


@lru_cache
def kept_snapshot(seed, steps, mode):
    env = gymnasium.make("ActiveSLAM-v0", render_mode=mode, lost_position_error=9.0).unwrapped
    env.reset(seed=seed)
    for step in range(steps):
        env.step((Motion.LEFT if step // 8 % 2 else Motion.FORWARD, Gaze.LEFT))
    return env.snapshot()


def make_snapshot(seed=0, steps=60, mode="rgb_array"):
    """A moment of a run in arrays of the test's own; nothing is kept of the past without a ``mode`` to render in."""
    return copy.deepcopy(kept_snapshot(seed, steps, mode))


@pytest.mark.parametrize("size", [None, (333, 217), (1200, 700)])
def test_every_size_is_met_to_the_pixel_and_no_panel_is_blank(size):
    picture = rendering.draw(make_snapshot(), size) if size else rendering.draw(make_snapshot())
    width, height = size or (960, 640)
    assert picture.shape == (height, width, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    panels = np.s_[70:560, 20:600], np.s_[90:300, 660:930], np.s_[390:560, 660:930]
    assert size or all(picture[panel].astype(float).std() > 5 for panel in panels)


@pytest.mark.filterwarnings("error")
def test_same_snapshot_same_picture_and_the_users_settings_are_left_alone():
    import matplotlib
    import matplotlib.pyplot as pyplot

    before, figures = dict(matplotlib.rcParams), pyplot.get_fignums()
    first = rendering.draw(make_snapshot(seed=1))
    assert not np.array_equal(rendering.draw(make_snapshot(seed=2, steps=12, mode=None)), first)
    with matplotlib.rc_context({"figure.autolayout": True}):
        rendering._offscreen_picture.cache_clear()
        np.testing.assert_array_equal(rendering.draw(make_snapshot(seed=1)), first)
    assert dict(matplotlib.rcParams) == before and pyplot.get_fignums() == figures


def test_threads_draw_what_one_draws():
    moments = [make_snapshot(seed=1), make_snapshot(seed=2, steps=12)] * 4
    with ThreadPoolExecutor(4) as pool:
        for together, alone in zip(pool.map(rendering.draw, moments), map(rendering.draw, moments)):
            np.testing.assert_array_equal(together, alone)


@pytest.mark.filterwarnings("error")
def test_nothing_to_draw_a_lost_belief_and_degenerate_covariances_still_make_a_picture():
    snapshot = make_snapshot(steps=0, mode=None)
    assert len(snapshot.belief.landmarks) == len(snapshot.times) == 0
    none = np.zeros((0, 3))
    truth = replace(snapshot.truth, fiducials=none, landmarks=none)
    assert rendering.draw(replace(snapshot, expected_landmarks=none, truth=truth)).std() > 5
    snapshot = make_snapshot()
    belief = snapshot.belief
    for array in (belief.camera, belief.covariance, belief.points, snapshot.predicted, snapshot.predicted_covariance):
        array[:] = np.nan
    snapshot.entropy[-1] = np.nan
    assert rendering.draw(snapshot).std() > 5
    snapshot = make_snapshot()
    snapshot.belief.covariance[:] = snapshot.predicted_covariance[:] = 0.0
    assert rendering.draw(snapshot).std() > 5


def test_view_is_right_handed_and_the_frustum_projects_back_to_the_image():
    """A mirrored room would show a gaze to the LEFT turning right."""
    axes = np.vstack((scene.VIEW, scene.TOWARDS_VIEWER))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 0] < 0 and axes[1, 1] > 0 and axes[0, 1] == pytest.approx(0.0)
    position, quaternion = np.random.default_rng(2).normal(size=3), np.array([0.5, -0.5, 0.1, 0.7])
    corners = scene.camera_frustum(Scenario(), position, quaternion, 0.7)[-1]
    x, y, z = Rotation.from_quat(quaternion, scalar_first=True).inv().apply(corners - position).T
    pixels = np.stack((162 - 195 * x / z, 125 - 195 * y / z), axis=1)
    np.testing.assert_allclose(pixels, [(0, 0), (320, 0), (320, 240), (0, 240)], atol=1e-9)


def test_ellipses_great_circles_and_outlines_lie_at_their_sigmas():
    def squares(points, covariances):
        return np.einsum("nki,nij,nkj->nk", points, np.linalg.inv(covariances), points)

    rng = np.random.default_rng(0)
    for dimension, curves in ((2, scene.ellipses), (3, scene.great_circles)):
        covariances = np.array([random_spd(rng, np.linspace(0.3, 1.0, dimension)) for _ in range(4)])
        means = rng.normal(size=(4, dimension))
        points = curves(means, covariances, 2.0).reshape(4, -1, dimension) - means[:, None]
        np.testing.assert_allclose(squares(points, covariances), 4.0)
    origin, on_page = np.zeros((4, 3)), scene.VIEW @ covariances @ scene.VIEW.T
    np.testing.assert_allclose(squares(scene.ellipsoid_outlines(origin, covariances, 2.0), on_page), 4.0)


def test_window_without_a_screen_names_the_alternative():
    pyplot.switch_backend("agg")
    with pytest.raises(rendering.NoScreen, match="rgb_array"):
        rendering.Window().show(make_snapshot())
    assert not pyplot.get_fignums()


def test_window_shows_redraws_and_closes(monkeypatch):
    manager = type("Manager", (FigureManagerBase,), {"show": lambda _: None})  # as every backend with windows has
    monkeypatch.setattr("matplotlib.backends.backend_agg.FigureCanvasAgg.manager_class", manager)
    pyplot.switch_backend("agg")
    window = rendering.Window()
    window.show(make_snapshot(seed=1))
    window.show(make_snapshot(seed=2))
    assert len(pyplot.get_fignums()) == 1
    pyplot.close("all")  # the user's click
    window.show(make_snapshot(seed=1))
    assert not pyplot.get_fignums()
    window.close()
    window.show(make_snapshot(seed=1))
    assert len(pyplot.get_fignums()) == 1
    window.close()
