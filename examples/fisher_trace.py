"""What the trace of the Fisher information says of one landmark, beside mutual information: the table of the manual."""

import numpy as np

from activeslam_gym import Scenario
from activeslam_gym.camera import camera_of
from activeslam_gym.information import CRITERIA
from activeslam_gym.slam.sight import sight_of_points

TABLE = """
| The landmark is known to | `fisher_trace` | `mutual_information` |
|---|---|---|
| 2 cm in every direction | 9086 | 1.65 bit |
| 2 cm, and 60 cm along the line of sight | 9086 | 1.65 bit |
| 1 m in every direction | 12 | 11.2 bit |
"""

STDS = ((0.02, 0.02, 0.02), (0.02, 0.02, 0.6), (1.0, 1.0, 1.0))
"""Of the landmark along the camera's x, y, z [m], a row of the table each."""


def main() -> list[tuple[float, float]]:
    """Print and return `fisher_trace` and `mutual_information` [bit] of each row."""
    camera = camera_of(Scenario(distortion=0.0, principal_x_px=160.0, principal_y_px=120.0))
    pose, landmark = np.array([0.0, 0.0, 0.0, 1.0, *np.zeros(9)]), np.array([[0.0, 0.0, 2.0]])
    fiducials, boxes = np.empty((0, 3)), np.empty((0, 2, 3))  # none
    rows = []
    for stds in STDS:
        P = np.diag(np.square([0.02] * 3 + [0.005] * 3 + [0.1] * 6 + list(stds)))
        sight = sight_of_points(camera, boxes, pose, fiducials, landmark, np.ones(len(landmark), bool), P)
        trace, bits = (CRITERIA[name](P, sight, camera.pixel_std**2) for name in ("fisher_trace", "mutual_information"))
        rows.append((float(trace), float(bits)))
        print(f"{stds}: trace {trace:.0f}, mutual information {bits:.2f} bit")
    return rows


if __name__ == "__main__":
    main()
