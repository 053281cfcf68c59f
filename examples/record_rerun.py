"""An episode for the Rerun viewer (the extra `rerun`): map, cameras, image and curves over time.

    python examples/record_rerun.py sweep sweep.rrd && rerun sweep.rrd

Axes are the environment's own (x left, y up, z forward), and Rerun is told so. Its pinhole has no distortion, so the
pixels lie a little inside those of their rays.
"""

import sys
from typing import Any

import gymnasium as gym
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

import activeslam_gym  # noqa: F401
import baselines
from activeslam_gym.evaluation import run_episode
from activeslam_gym.rendering.scene import believed_points, ellipses, predicted_pixels

CURVES = ("entropy", "log_score", "position_error", "landmarks_mapped")


def begin(scenario: Any, path: str) -> None:
    """Open the file, and log what stays: the axes and both cameras' lenses."""
    rr.init("activeslam_gym")
    rr.save(path)
    rr.log("world", rr.ViewCoordinates.LUF, static=True)
    lens = {
        "focal_length": scenario.focal_px,
        "principal_point": (scenario.principal_x_px, scenario.principal_y_px),
        "resolution": (scenario.image_width, scenario.image_height),
        "camera_xyz": rr.ViewCoordinates.LUF,
    }
    for camera in ("truth", "belief"):
        rr.log(f"world/{camera}", rr.Pinhole(**lens, image_plane_distance=0.5), static=True)


def log(core: Any, info: dict[str, Any]) -> None:
    """Log the present moment: `run_episode` calls it after the reset and after every step."""
    now = core.snapshot()
    rr.set_time("time", duration=now.time)
    rr.log("world/room", rr.Boxes3D(half_sizes=[now.room_size / 2]))
    for camera, at in {"truth": now.truth, "belief": now.belief}.items():
        pose = rr.Transform3D(translation=at.position, quaternion=np.roll(at.quaternion, -1))
        rr.log(f"world/{camera}", pose)
    means, covariances, _ = believed_points(now)
    variances, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.linalg.det(axes)[:, None]  # rotations, no reflections
    turns, halves = Rotation.from_matrix(axes).as_quat(), 2.0 * np.sqrt(np.maximum(variances, 0.0))
    rr.log("world/features", rr.Ellipsoids3D(centers=means, half_sizes=halves, quaternions=turns))
    rr.log("world/landmarks", rr.Points3D(now.truth.landmarks, radii=[0.02]))
    rr.log("world/expected", rr.Points3D(now.expected_landmarks, radii=[0.01]))
    rr.log("world/belief/predicted", rr.LineStrips2D(ellipses(*predicted_pixels(now), 3.0)))
    rr.log("world/belief/detected", rr.Points2D(now.detections, radii=[2.0]))
    for name in CURVES:
        rr.log(name, rr.Scalars(float(info[name])))


if __name__ == "__main__":
    name, path = sys.argv[1:] or ("sweep", "sweep.rrd")
    env = gym.make("ActiveSLAM-v0", duration=3.0)
    begin(env.unwrapped.scenario, path)
    episode = run_episode(env, baselines.make(name, env), seed=0, observers=[log])
    print(f"{path}: {episode.times[-1]:g} s of {name}")
