"""A sensor of your own: the filter without an environment, which takes whatever pixels it is handed."""

from collections.abc import Callable

import numpy as np

from activeslam_gym import Scenario
from activeslam_gym.camera import pixel_from_camera_point
from activeslam_gym.slam.detection import NEW
from activeslam_gym.slam.filter import Filter, detections_of
from activeslam_gym.slam.sight import Sight

FIDUCIALS = np.array([[0.6, 0.4, 1.6], [-0.6, 0.4, 1.8], [-0.5, -0.4, 1.5], [0.5, -0.3, 1.9]])
"""Of known position [m]: X is to the left of a camera that looks along Z, Y is up."""
UNKNOWN = np.array([0.2, 0.1, 2.5])
"""What is to be found [m]."""
Sensor = Callable[[int, Sight], np.ndarray]


def follow(slam: Filter, sensor: Sensor, frames: int) -> None:
    """Hand what ``sensor`` returns, pixels (M, 2), to the filter: of each frame, and around the predicted pixels."""
    for frame in range(frames):
        slam.predict()  # a frame ahead; u: known accelerations, dt: another time
        sight = slam.sight()  # sight.point: id, z_hat; sight.S: how far from there to look
        pixels = sensor(frame, sight)
        detections = detections_of(pixels, R=4.0 * np.eye(2))  # each may have an R of its own, an id, a likelihood
        matched = slam.update(detections)  # ids, or NEW, or REJECTED: too near to something to be new
        for pixel in pixels[matched == NEW]:
            slam.add_landmark(pixel)


def position_at(frame: int) -> np.ndarray:
    """Where the camera of this scene really is [m]: it sways from side to side, as nobody tells the filter."""
    return np.array([0.05 + 0.25 * np.sin(0.05 * frame), -0.03, 0.04])


def true_pixels(slam: Filter) -> Sensor:
    """A sensor that sees all points from `position_at`, looking along Z. Yours asks a detector."""

    def sensor(frame: int, sight: Sight) -> np.ndarray:
        pixels = np.empty((5, 2))
        for pixel, point in zip(pixels, (*FIDUCIALS, UNKNOWN), strict=True):
            pixel_from_camera_point(slam.camera, point - position_at(frame), pixel)
        return pixels

    return sensor


def main(frames: int = 40) -> Filter:
    """Follow the scene for some frames, and tell what the filter knows."""
    slam = Filter(Scenario(landmark_count=5), fiducials=FIDUCIALS)
    follow(slam, true_pixels(slam), frames)
    points, P = slam.points()
    stds = 1e2 * np.sqrt(np.diag(P))
    print("camera [cm]:", 1e2 * slam.belief.state.camera[:3], "±", stds[:3])
    for id, point, std in zip(slam.ids, points, stds[12:].reshape(-1, 3), strict=True):
        print(f"feature {id} [cm]:", 1e2 * point, "±", std)
    return slam


if __name__ == "__main__":
    np.set_printoptions(precision=1, suppress=True)
    main()
