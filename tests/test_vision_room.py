"""The rendered room: geometry against the camera's equation, pictures against what they are pictures of."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from activeslam_gym.camera import camera_of, camera_point, pixel_from_camera_point
from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.geometry import quaternion_exp, rotate_left, rotation_matrix
from activeslam_gym.vision.room.camera import RoomCamera, target_seen
from activeslam_gym.vision.room.geometry import Scene, scene_point
from activeslam_gym.vision.room.lens import TILE_HEIGHT, TILE_WIDTH, Lens, lens_of
from activeslam_gym.vision.room.render import render, workspace_of
from activeslam_gym.vision.room.scene import draw_scene
from activeslam_gym.vision.room.sensor import Sensor, gain, sensor_of
from activeslam_gym.vision.room.shading import SIZE
from activeslam_gym.vision.room.textures import texture_library, write_pyramid
from activeslam_gym.vision.search import search
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import empty_templates, store

PLAIN = sensor_of(exposure=0.0, noise_std=0.0, gain_std=0.0)
KEY = np.array([11], np.uint64)
CAMERA = camera_of(Scenario())


@cache
def lens() -> Lens:
    return lens_of(CAMERA)


@cache
def room(seed: int) -> Scene:
    return draw_scene(Scenario(), np.random.default_rng(seed))


def state(position=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), rate=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A camera (13,), turned by the rotation vector ``turn`` from facing +Z."""
    return np.concatenate([position, quaternion_exp(np.array(turn)), velocity, rate])


def random_state(rng: np.random.Generator, reach: float = 1.0) -> np.ndarray:
    """Somewhere in the middle of the room, looking anywhere, tilted by up to half a radian."""
    x = state(rng.uniform(-1.0, 1.0, 3) * np.array([reach, 0.6, reach]), (0.0, rng.uniform(-np.pi, np.pi), 0.0))
    x[3:7] = rotate_left(rng.uniform(-0.3, 0.3, 3), x[3:7])
    return x


def photograph(
    scene: Scene, x: np.ndarray, sensor: Sensor = PLAIN, frame: int = 0, key: np.ndarray = KEY
) -> np.ndarray:
    image = np.zeros((int(CAMERA.height), int(CAMERA.width)), np.uint8)
    render(scene, lens(), sensor, x, frame, key, workspace_of(scene, lens()), image)
    return image


def projection(x: np.ndarray, point: np.ndarray) -> np.ndarray:
    z = np.full(2, np.nan)
    pixel_from_camera_point(CAMERA, camera_point(rotation_matrix(x[3:7]), x, point), z)
    return z


# The scene ------------------------------------------------------------------------------------------------------------


def test_a_feature_of_a_slanted_wall_is_on_it_and_one_of_an_edge_in_front() -> None:
    pytest.importorskip("cv2")
    from activeslam_gym.vision.room.camera import RoomCamera

    camera = RoomCamera(SCENARIOS["pixels"], CAMERA, np.random.SeedSequence(3))
    rng, x, plain, edges = np.random.default_rng(0), state(turn=(0.1, 0.6, 0.0)), 0, 0
    around = [np.array((i, j)) for i in (-2.0, 0.0, 2.0) for j in (-2.0, 0.0, 2.0)]
    for pixel in rng.uniform((10.0, 10.0), (310.0, 230.0), (400, 2)):
        point, surface, _ = scene_point(camera.scene, x, CAMERA, pixel)
        beside = [scene_point(camera.scene, x, CAMERA, pixel + step)[:2] for step in around]
        nearest = min(np.linalg.norm(other) for other, _ in beside)
        if all(other == surface for _, other in beside):
            np.testing.assert_allclose(camera.point(x, pixel), point, atol=1e-9)
            plain += 1
        elif nearest < 0.7 * np.linalg.norm(point):
            assert np.linalg.norm(camera.point(x, pixel)) == pytest.approx(nearest)
            edges += 1
    assert plain > 200 and edges > 2


@pytest.mark.parametrize("seed", range(20))
def test_a_room_leaves_the_start_free_and_shows_its_target(seed: int) -> None:
    scene = room(seed)
    nearest = np.clip(0.0, scene.boxes[:, 0], scene.boxes[:, 1])
    assert np.linalg.norm(nearest, axis=1).min() > 1.0
    for a in range(len(scene.boxes)):
        for b in range(a):
            lows, highs = scene.boxes[[a, b], 0], scene.boxes[[a, b], 1]
            overlap = np.minimum(*highs) - np.maximum(*lows)
            assert not (overlap[[0, 2]] > 0).all(), "two boxes share a place in plan"
    for corner in scene.target:
        pixel = projection(state(), corner)
        assert (pixel > 20).all() and (pixel < [300, 220]).all()
        point, _, hit = scene_point(scene, state(), CAMERA, pixel)
        assert hit and np.linalg.norm(point - corner) < 1e-6, "something hides the target"
        assert 1.2 <= corner[2] <= 2.0
    width, height = np.linalg.norm(scene.target[1] - scene.target[0]), np.linalg.norm(scene.target[3] - scene.target[0])
    assert (width, height) == pytest.approx((0.30, 0.21))


def test_the_same_seed_gives_the_same_room_and_another_seed_another() -> None:
    again = draw_scene(Scenario(), np.random.default_rng(3))
    assert np.array_equal(room(3).surfaces, again.surfaces) and np.array_equal(room(3).boxes, again.boxes)
    assert not np.array_equal(room(3).boxes, room(4).boxes)
    texture_library.cache_clear()
    assert np.array_equal(room(3).textures, texture_library(0))


def test_a_large_hall_can_be_drawn() -> None:
    scene = draw_scene(Scenario(room_size=(14.0, 4.0, 14.0)), np.random.default_rng(0))
    assert photograph(scene, state()).std() > 10.0


def test_what_a_pixel_shows_projects_to_it() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        x, pixel = random_state(rng), rng.uniform([0.0, 0.0], [319.0, 239.0])
        point, surface, hit = scene_point(room(0), x, CAMERA, pixel)
        assert hit and 0 <= surface < len(room(0).surfaces)
        assert projection(x, point) == pytest.approx(pixel, abs=1e-6)


# The picture ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_surface_is_seen(seed: int) -> None:
    scene, rng = room(seed), np.random.default_rng(seed)
    surfaces = scene.surfaces.copy()
    surfaces["texture"], surfaces["brightness"] = np.arange(len(surfaces)), 1.0
    grey = (20 + 3 * np.arange(len(surfaces))).astype(np.uint32)
    own = np.repeat(grey * np.uint32(0x01010101), 2 * SIZE * SIZE).reshape(-1, 2 * SIZE, SIZE)
    labelled = scene._replace(surfaces=surfaces, textures=own)
    for _ in range(12):
        x = random_state(rng, 2.4)
        image = photograph(labelled, x)
        even = ndimage.maximum_filter(image, 5) == ndimage.minimum_filter(image, 5)
        assert even.mean() > 0.5
        for _ in range(200):
            v, u = rng.integers(240), rng.integers(320)
            if even[v, u]:
                _, surface, hit = scene_point(scene, x, CAMERA, np.array([float(u), float(v)]))
                assert hit and image[v, u] == grey[surface]


def test_the_target_is_where_the_camera_equation_has_it() -> None:
    rng, errors = np.random.default_rng(1), []
    for seed in range(4):
        for _ in range(5):
            x = state(rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.15, 0.15, 3))
            if all((np.abs(projection(x, corner) - [160, 120]) < [145, 105]).all() for corner in room(seed).target):
                errors.append(edge_errors(photograph(room(seed), x), x, room(seed).target))
    error = np.array(errors)
    assert len(error) > 10
    assert np.abs(error).max() < 0.1, "a corner lies where two edges meet"


def edge_errors(image: np.ndarray, x: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How far inside their places [px] the four edges of a black rectangle are seen, by the grey across them."""
    errors, across = [], np.arange(-3.0, 3.0, 0.05)
    for a, b in zip(corners, np.roll(corners, -1, 0)):
        inwards = corners.mean(0) - 0.5 * (a + b)
        at_edge = []
        for share in np.linspace(0.2, 0.8, 13):
            z, further = (projection(x, a + part * (b - a)) for part in (share, share + 0.001))
            normal = np.array([z[1] - further[1], further[0] - z[0]]) / np.linalg.norm(further - z)
            normal *= np.sign(normal @ (projection(x, a + share * (b - a) + 0.01 * inwards) - z))
            line = z[:, None] + normal[:, None] * across
            profile = ndimage.map_coordinates(image.astype(float), line[::-1], order=1)
            white, black = profile[:10].mean(), profile[-10:].mean()
            at_edge.append(((profile - black) / (white - black)).sum() * 0.05 - 3.0)
        errors.append(np.mean(at_edge))
    return np.array(errors)


def test_corners_stay_where_they_are_while_the_camera_moves() -> None:
    for sensor in (PLAIN, sensor_of()):
        error = corner_drift(room(0), sensor, 16)
        found = np.abs(error).max(1) < 1.0
        assert len(error) > 50 and found.mean() > 0.98
        assert error[found].std(0).max() < 0.1 and np.abs(error[found].mean(0)).max() < 0.05


def corner_drift(scene: Scene, sensor: Sensor, frames: int) -> np.ndarray:
    """(n, 2) [px]: patches at corners of the first image, found again in others, less where they project to."""
    path = [state((0.016 * k, 0.006 * k, 0.02 * k), (0.004 * k, 0.01 * k, 0.002 * k)) for k in range(frames)]
    first, errors = photograph(scene, path[0], sensor).astype(float), []
    corners, first = strong_corners(first), ndimage.spline_filter(first)
    for k in range(3, frames, 4):
        image = ndimage.spline_filter(photograph(scene, path[k], sensor, k).astype(float))
        for corner in corners:
            point, surface, _ = scene_point(scene, path[0], CAMERA, corner)
            z = projection(path[k], point)
            if (np.abs(z - [160, 120]) < [145, 105]).all():
                template = patch_from(scene, first, path[0], path[k], surface, z)
                if template is not None:
                    errors.append(best_shift(template, image, z))
    return np.array(errors).reshape(-1, 2)


PATCH = np.stack(np.meshgrid(np.arange(-6.0, 7.0), np.arange(-6.0, 7.0)), axis=-1).reshape(-1, 2)


def patch_from(
    scene: Scene, first: np.ndarray, x: np.ndarray, y: np.ndarray, surface: int, z: np.ndarray
) -> np.ndarray | None:
    """The patch about ``z`` in the image of ``y``, as the splines ``first`` of that of ``x`` have it, if plane."""
    pixels = []
    for step in PATCH:
        point, here, _ = scene_point(scene, y, CAMERA, z + step)
        pixels.append(projection(x, point))
        if here != surface or scene_point(scene, x, CAMERA, pixels[-1])[1] != surface:
            return None
    return ndimage.map_coordinates(first, np.array(pixels).T[::-1], prefilter=False)


def best_shift(template: np.ndarray, image: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Where about ``z`` in the splines ``image`` the template correlates best, by a parabola; 9: not within 3 px."""
    scores = np.empty((7, 7))
    for v in range(7):
        for u in range(7):
            at = (z + PATCH + [u - 3, v - 3]).T[::-1]
            scores[v, u] = np.corrcoef(template, ndimage.map_coordinates(image, at, prefilter=False))[0, 1]
    v, u = np.unravel_index(scores.argmax(), scores.shape)
    if not (0 < u < 6 and 0 < v < 6 and scores[v, u] > 0.8):
        return np.array([9.0, 9.0])

    def vertex(a: float, b: float, c: float) -> float:
        return 0.5 * (a - c) / (a - 2.0 * b + c)

    return np.array([u - 3 + vertex(*scores[v, u - 1 : u + 2]), v - 3 + vertex(*scores[v - 1 : v + 2, u])])


def strong_corners(image: np.ndarray, count: int = 60) -> list[np.ndarray]:
    """The best pixels by Shi and Tomasi's criterion, 7 px apart."""
    smooth = ndimage.gaussian_filter(image, 0.7)
    dv, du = np.gradient(smooth)
    uu, uv, vv = (ndimage.uniform_filter(a * b, 9) for a, b in ((du, du), (du, dv), (dv, dv)))
    least = 0.5 * (uu + vv) - np.sqrt(0.25 * (uu - vv) ** 2 + uv**2)
    peaks = (least == ndimage.maximum_filter(least, 15)) & (least > 20.0)
    peaks[:15], peaks[-15:], peaks[:, :15], peaks[:, -15:] = False, False, False, False
    v, u = np.nonzero(peaks)
    return [np.array([u[i], v[i]], float) for i in np.argsort(-least[v, u])[:count]]


def test_a_pattern_finer_than_the_pixels_is_grey() -> None:
    scene = room(0)
    check = np.indices((SIZE, SIZE)).sum(0) % 2 * 200.0
    textures = np.zeros((1, 2 * SIZE, SIZE), np.uint32)
    write_pyramid(check, textures[0])
    surfaces = scene.surfaces[-6:].copy()  # the bare room
    surfaces["texture"], surfaces["brightness"], surfaces["owner"] = 0, 1.0, 0
    surfaces["texels"] *= 1.5
    image = photograph(Scene(surfaces, scene.boxes[:0], scene.target, textures), state(turn=(0.0, 0.3, 0.0)))
    assert 95 <= image.mean() <= 105 and image[60:180].std() < 6.0


# The sensor -----------------------------------------------------------------------------------------------------------


def test_a_picture_depends_on_its_arguments_alone() -> None:
    rng, scene = np.random.default_rng(5), room(1)
    states = [random_state(rng) for _ in range(6)]
    for x in states:
        x[7:] = rng.uniform(-1.0, 1.0, 6)
    alone = [photograph(scene, x, sensor_of(), k) for k, x in enumerate(states)]
    work, image = workspace_of(scene, lens()), np.zeros_like(alone[0])
    for k in (3, 1, 5, 0, 2, 4, 4):  # in any order, in a workspace that was used before
        render(scene, lens(), sensor_of(), states[k], k, KEY, work, image)
        assert np.array_equal(image, alone[k])
    with ThreadPoolExecutor(3) as pool:
        for mine, theirs in zip(alone, pool.map(lambda k: photograph(scene, states[k], sensor_of(), k), range(6))):
            assert np.array_equal(mine, theirs)
    assert not np.array_equal(alone[0], photograph(scene, states[0], sensor_of(), 7))
    assert not np.array_equal(alone[0], photograph(scene, states[0], sensor_of(), 0, np.array([12], np.uint64)))


def test_noise_has_the_deviation_asked_for_and_is_new_in_every_frame() -> None:
    x = state()
    clean = photograph(room(0), x).astype(float)
    noisy = [photograph(room(0), x, sensor_of(0.0, 3.0, 0.0), k) - clean for k in range(2)]
    grey = (clean > 30) & (clean < 225)
    for noise in noisy:
        assert noise[grey].std() == pytest.approx(np.sqrt(9.0 + 1.0 / 6.0), rel=0.02)
        assert abs(noise[grey].mean()) < 0.05
        assert abs(np.corrcoef(noise[:, 1:].ravel(), noise[:, :-1].ravel())[0, 1]) < 0.02
        assert abs(np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(noisy[0].ravel(), noisy[1].ravel())[0, 1]) < 0.02


def test_gain_drifts_slowly_by_the_deviation_asked_for() -> None:
    sensor = sensor_of(gain_std=0.05, gain_period=50)
    gains = np.array([gain(sensor, frame, KEY) for frame in range(0, 100_000, 10)])
    assert gains.std() == pytest.approx(0.05, rel=0.1) and gains.mean() == pytest.approx(1.0, abs=0.01)
    assert np.abs(np.diff([gain(sensor, frame, KEY) for frame in range(500)])).max() < 0.02


@pytest.mark.parametrize("axis", [0, 1], ids=["across", "down"])
def test_blur_follows_the_motion(axis: int) -> None:
    def roughness(image: np.ndarray) -> np.ndarray:
        dv, du = np.gradient(image[40:200, 60:260].astype(float))
        return np.array([np.abs(du).mean(), np.abs(dv).mean()])

    turn = (0.0, 4.0, 0.0) if axis == 0 else (4.0, 0.0, 0.0)
    blurred = photograph(room(0), state(rate=turn), sensor_of(0.02, 0.0, 0.0))
    left = roughness(blurred) / roughness(photograph(room(0), state()))
    assert left[axis] < 0.4 and left[axis] < 0.6 * left[1 - axis]


def test_blur_is_as_long_as_the_picture_moves() -> None:
    x = state((0.2, 0.1, -0.3), (0.1, 0.4, 0.05), (0.7, -0.4, 0.5), (0.3, -0.5, 0.4))
    work, image = workspace_of(room(0), lens()), np.zeros((240, 320), np.uint8)
    exposure = 0.02
    render(room(0), lens(), sensor_of(exposure), x, 0, KEY, work, image)
    for tile in range(0, 600, 7):
        middle = np.array([tile % 20 * TILE_WIDTH + 7.5, tile // 20 * TILE_HEIGHT + 3.5])
        point, surface, _ = scene_point(room(0), x, CAMERA, middle)
        near = [
            scene_point(room(0), x, CAMERA, middle + step)[1] for step in np.array([[4.0, 0], [-4, 0], [0, 4], [0, -4]])
        ]
        if set(near) == {surface}:
            ends = []
            for sign in (-0.5, 0.5):
                y = x.copy()
                y[:3] += sign * exposure * x[7:10]
                y[3:7] = rotate_left(sign * exposure * x[10:13], x[3:7])
                ends.append(projection(y, point))
            assert work.flows[tile] == pytest.approx(ends[1] - ends[0], abs=0.15)


def test_the_lens_is_free() -> None:
    scenario = Scenario(
        focal_px=150.0, principal_x_px=90.0, principal_y_px=70.0, distortion=0.0, image_width=180, image_height=130
    )  # no distortion, no whole number of tiles
    camera = camera_of(scenario)
    own = lens_of(camera)
    image = np.zeros((130, 180), np.uint8)
    render(room(0), own, PLAIN, state(), 0, KEY, workspace_of(room(0), own), image)
    for corner in room(0).target:
        pixel = np.zeros(2)
        pixel_from_camera_point(camera, camera_point(np.eye(3), state(), corner), pixel)
        u, v = (int(value) for value in pixel)
        assert image[v - 3 : v + 5, u - 3 : u + 5].std() > 25.0, "black meets white there"


def found_corners(x: np.ndarray, drawn_from: np.ndarray, fiducials: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(4, 2) the corners' pixels by search in ``image`` from ``x``, their templates drawn for another view."""
    picture, pixels = target_seen(CAMERA, fiducials.mean(axis=0), drawn_from[:7])
    templates = empty_templates(4)
    for k, pixel in enumerate(pixels):
        store(CAMERA, templates, k, -1 - k, picture, pixel, drawn_from, np.array((0.0, 0.0, 1.0)))
    guess = np.array([projection(x, corner) for corner in fiducials]) + 0.7
    S = np.tile(np.eye(2), (4, 1, 1))
    found = search(CAMERA, FrontEndSettings().search(False), templates, image, x, np.arange(4), fiducials, guess, S)
    return np.where(found.peaks[:, None] > 0, found.pixel[:, 0], np.nan)


@pytest.mark.parametrize(
    "place", [(0.0, 0.0, -1.0), (0.0, 0.0, -1.9), (0.7, 0.2, -1.7), (0.0, 0.0, -2.9), (-0.9, 0.1, -2.4)]
)
def test_the_target_is_drawn_as_it_is_photographed(place) -> None:
    """At every distance, up to the sensor's noise; and its corners are found without a bias, with looks that were drawn
    for a view 0.06 rad off."""
    eye = RoomCamera(SCENARIOS["pixels"], CAMERA, np.random.SeedSequence(4))
    middle, errors = eye.fiducials.mean(axis=0), []
    for k in range(12):  # twelve phases of the pixels
        x = state(
            middle + place + 0.01 * np.array((np.cos(k), np.sin(2 * k), np.sin(k))), (0.01 * k, 0.02 * np.cos(k), 0.0)
        )
        other = state(x[:3] + 0.06 * np.linalg.norm(place) * np.array((0.7, 0.1, 0.7)), (0.0, 0.03, 0.0))
        image = eye.photograph(x, k + 1).astype(np.float32)
        picture, corners = target_seen(CAMERA, middle, x[:7])
        np.testing.assert_allclose(corners, [projection(x, corner) for corner in eye.fiducials], atol=1e-9)
        seen = np.isfinite(picture)
        contrast, black = np.polyfit(picture[seen], image[seen], 1)
        assert np.std(image[seen] - contrast * picture[seen] - black) < 4.0  # of which 2 are noise
        errors.append(found_corners(x, other, eye.fiducials, image) - corners)
    assert np.isfinite(errors).all()
    assert np.sqrt(np.mean(np.square(errors))) < 0.05 and np.abs(np.mean(errors, axis=0)).max() < 0.04


def test_nobody_knows_what_is_beside_the_sheet() -> None:
    middle = np.array((0.1, 0.2, 3.0))
    picture, corners = target_seen(CAMERA, middle, state()[:7])
    known = np.argwhere(np.isfinite(picture))[:, ::-1]
    wide, size = known.max(axis=0) - known.min(axis=0), corners[3] - corners[0]
    assert (1.6 * size < wide).all() and (wide < 2.0 * size).all()  # the sheet is twice the target, less its rim
    for place in ((0.0, 0.0, 4.0), (2.0, 0.0, 2.9)):  # behind it, and beside its edge
        with pytest.raises(ValueError, match="not seen from before it"):
            target_seen(CAMERA, middle, state(place)[:7])
    with pytest.raises(ValueError, match="behind the camera"):
        target_seen(CAMERA, middle, state(turn=(0.0, np.pi, 0.0))[:7])
