"""A state of a live run without a run."""

import numpy as np

from activeslam_gym.live.state import About, Standing, State
from activeslam_gym.motion import Motion

ABOUT = About("a <test>", (320, 240), 195.0, 15.0, (6.0, 2.0, 6.0), True)


def a_state(frame: int = 1, n: int = 12) -> State:
    rng = np.random.default_rng(frame)
    return State(
        frame=frame, time=frame / 15, image=rng.integers(0, 255, (240, 320)).astype(np.uint8),
        standing=Standing.TRACKING, words="Tracking.", camera=np.eye(1, 13, 3)[0], camera_covariance=1e-4 * np.eye(3),
        ids=np.arange(1, n + 1), points=rng.normal(0, 1, (n, 3)), covariances=np.tile(1e-3 * np.eye(3), (n, 1, 1)),
        mapped=np.arange(n) % 2 == 0, fiducials=np.zeros((4, 3)), searched=np.arange(1, n + 1),
        pixels=rng.uniform(20, 220, (n, 2)), ellipses=np.tile(9.0 * np.eye(2), (n, 1, 1)), outcomes=np.arange(n) % 3,
        command=Motion.UP, scores=np.arange(7.0), advised=np.arange(7), log2_dets=np.array((-100.0, -200.0, -310.0)),
        landmarks=n, births=0, milliseconds=8.0, follows=True,
    )  # fmt: skip
