"""Checks of parts before an episode is played, as Gymnasium's `check_env` does for environments.

    check_scene(Scene)
    check_sensor(Sensor)
    check_estimator(Estimator, {"association": "known"})

Each takes a part, an object or its name, and a scenario; and raises ValueError for the first law that the part breaks.
The message names the part.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMEnv
from activeslam_gym.envs.setting import scenario_with
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION
from activeslam_gym.registry import array_of, asked, name_of, part_of
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.sensors.sensor import OWN_SENSORS, POINTS, measured, noise_of, seen_by
from activeslam_gym.slam.belief import start_of
from activeslam_gym.slam.estimate import EKF
from activeslam_gym.world.room import draw_scene

RAYS = 300
NEAR = 3e-3  # before and behind a surface [m]
NEAR_PIXEL = 3.0  # between a prediction and the pixel of the lens, in the scenario's `pixel_std`
GRAZING = 0.02  # share of rays that may graze a surface, where rounding decides
STEPS = 20
OVERCONFIDENT = 10.0  # times the expected normalised error squared
Given = str | Mapping[str, Any] | Scenario


def check_scene(scene: Any, scenario: Given = "paper", seed: int = 0) -> None:
    """Check a scene: bounds, lines of sight, clearances and samples agree with each other.

    Raises:
        ValueError: it fails, answers in another form, or breaks a law: two scenes of one seed are equal; a line of
            sight is blocked both ways or none; a body that stops a point blocks the line through it; a sampled point is
            on a surface, with its normal into free space, and is not hidden by its own body.
    """
    of = scenario_with(scenario, scene=scene)
    what, rng = f"the scene {name_of(of.scene)!r}", np.random.default_rng(seed)
    scene, again = (draw_scene(of, np.random.default_rng(seed)) for _ in range(2))
    half, (low, high) = 0.5 * np.array(of.room_size), scene.bounds
    points, normals = scene.sample(RAYS, np.random.default_rng(seed))
    same = np.array_equal(points, again.sample(RAYS, np.random.default_rng(seed))[0])
    _demand(same, what, "is another one each time, from the same seed")
    places = rng.uniform(low, high, (RAYS, 3))
    free = scene.clearance(places, _unit(rng.standard_normal((RAYS, 3))), 1.0) > NEAR
    _demand(free.any(), what, "has no free place among 300 of its bounds")
    places = places[free]
    ways, far = _unit(rng.standard_normal((len(places), 3))), float(np.linalg.norm(high - low))
    reach = scene.clearance(places, ways, far)
    wrong_before, wrong_behind, one_way = 0, 0, 0
    for a, way, length in zip(places, ways, reach, strict=True):
        before, behind = scene.blocks(a, np.array((a + way * (length - NEAR), a + way * (length + NEAR))))
        wrong_before += bool(before and length > NEAR)
        inside = (np.abs(a + way * (length + NEAR)) < half).all()  # the room's walls hide nothing inside
        wrong_behind += bool(not behind and length < far and inside)
        target = points[rng.integers(len(points))]
        one_way += bool(scene.blocks(a, target[None])[0] != scene.blocks(target, a[None])[0])
    few = GRAZING * len(places)
    _demand(wrong_before <= few, what, f"blocks() cuts {wrong_before} of {len(places)} lines before their clearance()")
    _demand(wrong_behind <= few, what, f"blocks() lets {wrong_behind} of {len(places)} lines past their clearance()")
    _demand(one_way <= few, what, f"blocks() differs from b to a in {one_way} of {len(places)} lines")
    outside, on_wall = points + 4.0 * NEAR * normals, (np.abs(np.abs(points) - half) < NEAR).any(axis=1)
    back = scene.clearance(outside, -normals, 1.0)
    apart = int((~on_wall & (np.abs(back - 4.0 * NEAR) > NEAR)).sum())
    _demand(apart <= few, what, f"sample() has {apart} of {RAYS} points that are on no surface, or normals into it")
    hidden = sum(bool(scene.blocks(a, b[None])[0]) for a, b in zip(outside, points, strict=True))
    _demand(hidden <= few, what, f"blocks() hides {hidden} of {RAYS} points from the place before their own surface")


def check_sensor(sensor: Any, scenario: Given = "paper", seed: int = 0) -> None:
    """Check a sensor.

    Raises:
        ValueError: it fails, answers in another form, or breaks a law: a prediction begins with the pixel of the lens;
            noise depends on the seed and the time alone; it has the stated covariance; Jacobians are the numerical
            ones; what is measured is visible; half or more of what is visible, not blocked and not missed is measured.
    """
    of = scenario_with(scenario, sensor=sensor)
    what, make = f"the sensor {name_of(of.sensor)!r}", part_of("sensor", of.sensor, OWN_SENSORS)
    if make is None:
        raise ValueError(f"{what} is the package's own; allowed: one of yours")
    plain = replace(of, sensor=POINTS, estimator=EKF)
    env, lens = ActiveSLAMEnv(plain, end_when_lost=False), PointSensor(plain, np.random.SeedSequence(seed))
    env.reset(seed=seed)
    first, twin = (asked(what, make, of, np.random.SeedSequence(seed)) for _ in range(2))
    noise = noise_of(what, first)
    rng, seen, denied, missed = np.random.default_rng(seed), 0, 0, 0
    squares: list[float] = []
    env.action_space.seed(seed)
    for _ in range(min(STEPS, int(env.setting.task.steps))):
        env.step(env.action_space.sample())
        truth, time = env.truth, float(env.time)
        camera, points = truth.camera, np.concatenate((truth.fiducials, truth.landmarks))
        values, labels = measured(what, first, truth, time, len(noise))
        for one in (first, twin):
            same = np.array_equal(values, measured(what, one, truth, time, len(noise)).values)
            _demand(same, what, "measures something else at the same time, from the same seed")
        visible = seen_by(what, first, camera, points)
        real = labels >= 0
        seen, denied = seen + int(visible[labels[real]].sum()), denied + int((~visible[labels[real]]).sum())
        visible[labels[real]] = False
        missed += int((visible & ~truth.scene.blocks(truth.position, points)).sum())
        for value, label in zip(values[real], labels[real], strict=True):
            z, H_x, H_y = _predicted(first, what, camera, points[label], len(noise))
            pixel, _, _ = lens.predict(camera, points[label])
            near = (np.abs(z[:2] - pixel) <= NEAR_PIXEL * of.pixel_std).all()
            _demand(near, what, f"predicts {z}, which does not begin with the pixel of the scenario's lens, {pixel}")
            squares.append((value - z) @ np.linalg.solve(noise, value - z))
            if rng.random() < 0.1:
                _check_jacobians(first, what, camera, points[label], H_x, H_y)
    _demand(len(squares) > 0, what, f"measured no landmark in {env.time:g} s")
    _demand(denied <= 0.1 * (seen + denied), what, f"measures {denied} of {seen + denied} that visible() denies")
    least = 0.5 * (1.0 - of.missed_detection_probability)
    _demand(seen >= least * (seen + missed), what, f"measures {seen} of {seen + missed} that visible() shows")
    mean, slack = float(np.mean(squares)) / len(noise), 6.0 * np.sqrt(2.0 / (len(noise) * len(squares)))
    _demand(abs(mean - 1.0) <= slack + 0.1, what, f"has {mean:.2f} times the noise that it states")


def check_estimator(estimator: Any, scenario: Given = "paper", seed: int = 0) -> None:
    """Check an estimator in a short episode of random actions; forms are checked by the environment.

    Raises:
        ValueError: it fails, answers in another form, or breaks a law: it begins with the prior; covariances are
            positive definite; a landmark keeps its id; errors are not over `OVERCONFIDENT` times what it believes.
    """
    of = scenario_with(scenario, estimator=estimator)
    what = f"the estimator {name_of(of.estimator)!r}"
    env = ActiveSLAMEnv(of, end_when_lost=False)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    prior, begun = np.diag(start_of(of)[1]), np.diag(env.belief.covariance)[:CAMERA_DIM]
    _demand(np.allclose(begun, prior, rtol=1e-3, atol=1e-12), what, f"begins with variances {begun}, not {prior}")
    nees = []
    for _ in range(min(STEPS, int(env.setting.task.steps))):
        env.step(env.action_space.sample())
        belief = env.belief
        _demand(_positive(belief.covariance), what, f"has a covariance that is not positive definite at {env.time:g} s")
        nees.append(env.nees())
    for part in ("position", "orientation", "landmarks"):
        usual = float(np.median([one[part] for one in nees if not np.isnan(one[part])] or [0.0]))  # without landmarks
        breach = f"is overconfident, or wrong: squared errors of {part} are {usual:.0f} times what it believes"
        _demand(usual <= OVERCONFIDENT, what, breach)


def _demand(holds: Any, what: str, breach: str) -> None:
    if not holds:
        raise ValueError(f"{what} {breach}")


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _positive(P: np.ndarray) -> bool:
    """Whether a covariance is positive definite, in units of its own deviations."""
    size = np.sqrt(np.maximum(np.diag(P), 1e-300))
    return bool(np.isfinite(P).all() and np.linalg.eigvalsh(P / np.outer(size, size)).min() > -1e-9)


def _predicted(sensor: Any, what: str, camera: np.ndarray, point: np.ndarray, d: int) -> list[np.ndarray]:
    answer = asked(f"predict() of {what}", lambda: tuple(sensor.predict(camera, point)))
    _demand(len(answer) == 3, what, f"predicts {len(answer)} arrays, not a measurement and two Jacobians")
    shapes = (d,), (d, 6), (d, 3)
    return [array_of(f"predict() of {what}", one, shape) for one, shape in zip(answer, shapes)]


def _check_jacobians(
    sensor: Any, what: str, camera: np.ndarray, point: np.ndarray, H_x: np.ndarray, H_y: np.ndarray
) -> None:
    """Compare them with finite differences: a rotation is perturbed in the world frame."""
    from scipy.optimize import approx_fprime
    from scipy.spatial.transform import Rotation

    def measurement(delta: np.ndarray) -> np.ndarray:
        x = camera.copy()
        x[POSITION] += delta[:3]
        rotation = Rotation.from_rotvec(delta[3:6]) * Rotation.from_quat(x[QUATERNION], scalar_first=True)
        x[QUATERNION] = rotation.as_quat(scalar_first=True)
        return np.asarray(sensor.predict(x, point + delta[6:])[0], float)

    numerical = approx_fprime(np.zeros(9), measurement, 1e-6)
    for k, (given, right) in enumerate(zip(np.hstack((H_x, H_y)).T, numerical.T, strict=True)):
        scale = 1e-3 * max(1.0, float(np.abs(right).max()))
        of = f"column {k} of the Jacobians of predict(), {np.round(given, 4)}, is not {np.round(right, 4)}"
        _demand(not np.isfinite(right).all() or np.allclose(given, right, atol=scale), what, f"{of}")
