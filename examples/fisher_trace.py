"""What the trace of the Fisher information says of one landmark, beside mutual information: the table of the manual."""

from __future__ import annotations

import numpy as np

from activeslam_gym import Scenario, information
from activeslam_gym.camera import camera_of

TABLE = """
--8<-- [start:table]
| The landmark is known to | `fisher_trace` | `mutual_information` |
|---|---|---|
| 2 cm in every direction | 9086 | 1.65 bit |
| 2 cm, and 60 cm along the line of sight | 9086 | 1.65 bit |
| 1 m in every direction | 12 | 11.2 bit |
--8<-- [end:table]
"""

STDS = ((0.02, 0.02, 0.02), (0.02, 0.02, 0.6), (1.0, 1.0, 1.0))
"""Of the landmark along the camera's x, y, z [m], a row of the table each."""


def main() -> list[tuple[float, float]]:
    """Print and return `fisher_trace` and `mutual_information` [bit] of each row."""
    camera = camera_of(Scenario(distortion=0.0, principal_x_px=160.0, principal_y_px=120.0))
    pose = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rows = []
    for stds in STDS:
        P = np.diag(np.square([0.02] * 3 + [0.005] * 3 + [0.1] * 6 + list(stds)))
        sight = information.sight_from(
            camera, information.Prospect(pose, np.array([[0.0, 0.0, 2.0]]), P, np.empty((0, 3))), pose
        )
        S, _ = information.innovation_of(P, sight, camera.pixel_std**2)
        rows.append(
            (
                float(information.fisher_trace(P, sight, camera.pixel_std**2)),
                float(information.half_log2_ratio(S, camera.pixel_std**2)),
            )
        )
        print(f"{stds}: trace {rows[-1][0]:.0f}, mutual information {rows[-1][1]:.2f} bit")
    return rows


if __name__ == "__main__":
    main()
