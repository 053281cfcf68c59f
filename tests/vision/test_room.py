"""The rendered room: geometry against the camera's equation, pictures against their scenes, true points of features."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from scipy import ndimage

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of, ray_from_pixel
from activeslam_gym.config import CENTRE, CORNER, SCENARIOS, WALL, NoRoomError, Scenario
from activeslam_gym.geometry import quaternion_exp, rotate_left, rotation_matrix
from activeslam_gym.kernels import filled
from activeslam_gym.slam.detection import DETECTION
from activeslam_gym.vision.room import scene as scene_module
from activeslam_gym.vision.room.camera import FollowedPoints, RoomCamera, target_seen
from activeslam_gym.vision.room.geometry import Scene
from activeslam_gym.vision.room.render import Lens, Sensor, lens_of, render
from activeslam_gym.vision.room.scene import draw_scene
from activeslam_gym.vision.room.shading import SIZE
from activeslam_gym.vision.search import SEARCH, Findings, search
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import Templates, empty_templates, store
from activeslam_gym.vision.views import projected, view_from
from activeslam_gym.world.room import draw_room

PLAIN = Sensor(exposure=0.0, noise_std=0.0, gain_std=0.0)
KEY = np.array([11], np.uint64)
CAMERA = camera_of(Scenario())
WHOLE = np.array([[0, CAMERA.width, 0, CAMERA.height]], np.int64)


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


def photograph(scene: Scene, x: np.ndarray, sensor: Sensor = PLAIN, frame: int = 0, key=KEY) -> np.ndarray:
    return render(scene, lens(), sensor, x, frame, key, WHOLE)


def test_the_windows_of_a_photograph_are_parts_of_the_whole() -> None:
    rng, camera = np.random.default_rng(4), RoomCamera(Scenario(), CAMERA, np.random.SeedSequence(3))
    for frame in range(8):
        x = random_state(rng)
        x[7:] = rng.normal(0.0, 0.3 * frame, 6)  # from no blur to much
        left, top = rng.integers(-10, 300, 6), rng.integers(-10, 220, 6)
        windows = np.stack((left, left + rng.integers(5, 60, 6), top, top + rng.integers(5, 60, 6)), axis=1)
        whole, parts = camera.photograph(x, frame), camera.photograph(x, frame, windows)
        for a, b, c, d in windows.clip(0):
            np.testing.assert_array_equal(parts[c : d + 1, a : b + 1], whole[c : d + 1, a : b + 1])
        assert (parts != whole).mean() > 0.1, "not all is worked out"


def projection(x: np.ndarray, point: np.ndarray) -> np.ndarray:
    return projected(CAMERA, x, point[None])[0]


def met(scene: Scene, x: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The scene points (m, 3) of ``pixels`` (m, 2) and their surfaces (m,): the nearest of all rectangles."""
    rays = np.array([ray_from_pixel(CAMERA, pixel) for pixel in pixels]) @ rotation_matrix(x[3:7]).T
    corner, normal, along, down = (scene.surfaces[name] for name in ("corner", "normal", "along", "down"))
    height = ((x[:3] - corner) * normal).sum(axis=1)
    depth = height / np.maximum(-(rays @ normal.T), 1e-12)
    points = x[:3] + depth[..., None] * rays[:, None]
    on = np.broadcast_to(height > 0.0, depth.shape)
    for edge in (along, down):
        share = ((points - corner) * edge).sum(axis=2) / (edge**2).sum(axis=1)
        on = on & (share >= 0.0) & (share <= 1.0)
    depth = np.where(on, depth, np.inf)
    surface = (depth < depth.min(axis=1, keepdims=True) + 1e-9).argmax(axis=1)  # a poster is before its wall
    return points[np.arange(len(pixels)), surface], surface


def shown(scene: Scene, x: np.ndarray, pixel: np.ndarray) -> tuple[np.ndarray, int]:
    """The scene point of ``pixel`` and its surface."""
    points, surfaces = met(scene, x, pixel[None])
    return points[0], int(surfaces[0])


def test_a_feature_is_on_the_ray_of_its_pixel_and_on_its_wall() -> None:
    camera = RoomCamera(SCENARIOS["pixels"], CAMERA, np.random.SeedSequence(3))
    rng, x, plain, hung = np.random.default_rng(0), state(turn=(0.1, 0.6, 0.0)), 0, 0
    image, rows, columns = camera.photograph(x, 0), *np.mgrid[-7:8, -7:8]
    for pixel in rng.integers((12, 12), (308, 228), (400, 2)).astype(float):
        point, surface = shown(camera.scene, x, pixel)
        around, others = met(camera.scene, x, pixel + np.stack((columns.ravel(), rows.ravel()), axis=1))
        distances = np.linalg.norm(around, axis=1)
        followed = camera.points(x, pixel, image)[0]
        np.testing.assert_allclose(np.cross(followed, point), 0.0, atol=1e-9, err_msg="it is on the pixel's ray")
        assert distances.min() - 1e-9 < np.linalg.norm(followed) < distances.max() + 1e-9
        if len(np.unique(camera.scene.surfaces["plane"][others])) == 1:  # or a poster
            own = camera.scene.surfaces[np.unique(others)]
            heights = (own["normal"] * (point - own["corner"])).sum(axis=1)
            assert np.ptp(camera.scene.surfaces["normal"][others], axis=0).max() < 1e-9 and np.ptp(heights) < 1e-9
            np.testing.assert_allclose(followed, point, atol=1e-9)
            plain, hung = plain + 1, hung + (others != surface).any()
    assert plain > 150 and hung > 5, (plain, hung)


def assert_the_target_is_in_view(scene: Scene, x: np.ndarray) -> None:
    for corner in scene.target:
        pixel = projection(x, corner)
        assert (pixel > 20).all() and (pixel < [300, 220]).all()
        assert np.linalg.norm(shown(scene, x, pixel)[0] - corner) < 1e-6, "something hides the target"


@pytest.mark.parametrize("seed", range(20))
def test_a_room_leaves_the_start_free_and_shows_its_target(seed: int) -> None:
    scene = room(seed)
    assert np.linalg.norm(np.clip(0.0, scene.boxes[:, 0], scene.boxes[:, 1]), axis=1).min() > 1.0
    for one, other in combinations(scene.boxes, 2):
        overlap = np.minimum(one[1], other[1]) - np.maximum(one[0], other[0])
        assert not (overlap[[0, 2]] > 0).all(), "two boxes share a place in plan"
    assert_the_target_is_in_view(scene, state())
    assert ((scene.target[:, 2] >= 1.2) & (scene.target[:, 2] <= 2.0)).all()


@pytest.mark.parametrize("start", [CORNER, WALL])
@pytest.mark.parametrize("seed", range(6))
def test_a_camera_starts_in_a_corner_or_along_a_wall_before_its_target(start: str, seed: int) -> None:
    scenario, rng = Scenario(start=start, room_size=(7.0, 2.4, 9.0)), np.random.default_rng(seed)
    place, half = draw_room(scenario, rng).place, 0.5 * np.array(scenario.room_size)
    scene = draw_scene(scenario, rng, place)
    assert (np.abs(scene.boxes) <= half + 1e-9).all() and (scene.boxes[:, 0] < scene.boxes[:, 1]).all()
    for wall in scene.surfaces[-6:]:
        assert wall["normal"] @ wall["corner"] == pytest.approx(-np.abs(wall["normal"]) @ half)
        assert np.cross(wall["down"], wall["along"]) @ wall["normal"] > 0.0
    nearest = np.clip(place[:3], scene.boxes[:, 0], scene.boxes[:, 1])
    distances = np.linalg.norm((nearest - place[:3])[:, [0, 2]], axis=1)
    assert distances[0] > 0.8 and (distances[1:] > 1.29).all()
    x = np.concatenate((place, np.zeros(6)))
    assert_the_target_is_in_view(scene, x)
    assert projection(x, scene.target[0])[0] < projection(x, scene.target[1])[0]


@pytest.mark.parametrize("size", [(3.0, 2.0, 3.0), (1.0, 2.0, 1.0), (0.3, 2.0, 6.0), (6.0, 0.3, 6.0)])
@pytest.mark.parametrize("start", [CENTRE, CORNER])
def test_a_room_too_small_for_its_boxes_is_refused(size, start, monkeypatch) -> None:
    monkeypatch.setattr(scene_module, "_TRIES", 1000)
    scenario = Scenario(room_size=size, start=start, goal_margin=0.1)
    place = draw_room(scenario, np.random.default_rng(0)).place
    with pytest.raises(NoRoomError, match="scenario.room_size"):
        draw_scene(scenario, np.random.default_rng(0), place)


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
        for v, u in rng.integers((240, 320), size=(200, 2)):
            if even[v, u]:
                assert image[v, u] == grey[shown(scene, x, np.array([float(u), float(v)]))[1]]


def found_at(x: np.ndarray, templates: Templates, points: np.ndarray, image: np.ndarray, off: float) -> Findings:
    """The search of ``points`` (n, 3) in the ``image`` from ``x``, ``off`` [px] their true pixels."""
    model, places, n = filled(SEARCH, FrontEndSettings(), gate=11.8), np.arange(len(points)), len(points)
    guess, S = projected(CAMERA, x, points) + off, np.tile(np.eye(2), (n, 1, 1))
    return search(view_from(CAMERA, x), model, templates, image.astype(np.float32), places, points, guess, S)


@pytest.mark.parametrize("tilt", [1e-7, 1e-9, 1e-11])
def test_a_plane_whose_horizon_is_in_a_pixel_does_not_spoil_the_picture(tilt: float) -> None:
    """There a pixel is as long as the plane is: squares of its size on the texture once left 32 bits."""
    level = photograph(room(3), state()).astype(int)
    for sign in (-1.0, 1.0):
        tilted = photograph(room(3), state(turn=(sign * tilt, 0.0, 0.0)))
        assert np.abs(tilted - level).max() <= 1


@pytest.mark.parametrize(
    "place", [(0, 0, -1), (0, 0, -1.9), (0.7, 0.2, -1.7), (0, 0, -2.9), (-0.9, 0.1, -2.4), (0, 0, -3.4)]
)
def test_the_target_is_drawn_as_it_is_photographed(place) -> None:
    """At every distance, up to the sensor's noise; and its corners are found without a bias, with looks that were drawn
    for a view 0.06 rad off."""
    eye = RoomCamera(SCENARIOS["pixels"], CAMERA, np.random.SeedSequence(4))
    middle, errors = eye.fiducials.mean(axis=0), []
    for k in range(12):  # twelve phases of the pixels
        beside = 0.01 * np.array((np.cos(k), np.sin(2 * k), np.sin(k)))
        x = state(middle + place + beside, (0.01 * k, 0.02 * np.cos(k), 0.0))
        other = state(x[:3] + 0.06 * np.linalg.norm(place) * np.array((0.7, 0.1, 0.7)), (0.0, 0.03, 0.0))
        image = eye.photograph(x, k + 1).astype(np.float32)
        templates, corners = empty_templates(4), np.array([projection(x, corner) for corner in eye.fiducials])
        pictures, pixels = zip(*(target_seen(CAMERA, middle, x[:7], j) for j in range(4)))
        np.testing.assert_allclose(pixels, corners, atol=1e-9)
        seen = np.isfinite(pictures)
        drawn, photographed = np.array(pictures)[seen], np.broadcast_to(image, seen.shape)[seen]
        contrast, black = np.polyfit(drawn, photographed, 1)
        assert np.std(photographed - contrast * drawn - black) < 4.0  # of which 2 are noise
        for j in range(4):
            looks, pixel = target_seen(CAMERA, middle, other[:7], j)
            store(view_from(CAMERA, other), templates, j, -1 - j, looks, pixel, np.array((0.0, 0.0, 1.0)))
        found = found_at(x, templates, eye.fiducials, image, 0.7)
        assert found.peaks.all()
        errors.append(found.pixel[:, 0] - corners)
    assert np.sqrt(np.mean(np.square(errors))) < 0.05 and np.abs(np.mean(errors, axis=0)).max() < 0.04


START = np.eye(1, 13, 3)[0]  # facing +Z


@pytest.mark.parametrize(("way", "which", "lasting"), [(0.4, 0, 0.0), (0.4, 1, 0.0), (0.02, 0, 0.6), (0.02, 0, -0.6)])
def test_at_a_crossing_the_true_point_is_that_which_the_pixels_followed(way: float, which: int, lasting: float) -> None:
    """A camera that moves ``way`` [m] to the right; matches have a noise of 0.2 px and a ``lasting`` error along it."""
    camera, rng, tried = RoomCamera(SCENARIOS["pixels"], CAMERA, np.random.SeedSequence(3)), np.random.default_rng(0), 0
    image = camera.photograph(START, 0)
    for id, pixel in enumerate(rng.integers((20, 20), (300, 220), (300, 2)).astype(float), start=1):
        points = camera.points(START, pixel, image)
        distances = np.linalg.norm(points, axis=1)
        if len(points) != 2 or distances.min() > 0.8 * distances.max():
            continue
        truth, found = FollowedPoints(camera), np.zeros(1, DETECTION)
        found["match"], found["pixel"] = id, pixel
        truth.look(START, image, found)
        np.testing.assert_array_equal(truth.of(np.array([id]))[0], points[0], "until there is a match, the likeliest")
        found["id"] = id
        for x in -np.linspace(0.0, way, 21)[1:]:
            moved = START + x * np.eye(1, 13)[0]
            found["pixel"] = projected(CAMERA, moved, points[which, None])[0] + rng.normal((lasting, 0.0), 0.2)
            truth.look(moved, image, found)
        np.testing.assert_array_equal(truth.of(np.array([id]))[0], points[which])
        tried += 1
    assert tried > 10
