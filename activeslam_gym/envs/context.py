"""The context of an episode: what an agent of several scenarios is given beside the observation.

The observation is scaled by the scenario: positions by the room, time by the duration. So one policy for several
scenarios needs the scales. The filter knows them all; none is the truth of an episode.
"""

import numpy as np

from activeslam_gym.envs.run import Run

CONTEXT_FEATURES = {"half_room": 3, "duration": 1, "time_left": 1, "noise": 1, "acceleration": 1}
CONTEXT_FEATURES |= {"angular_acceleration": 1, "landmarks": 1, "inverse_depth": 1, "field_of_view": 1}
CONTEXT_FEATURES |= {"reach": 1, "command_known": 1}
"""Name and length of each part of the context, in order; `context_of` says what each is, and its scale."""
CONTEXT_SIZE = sum(CONTEXT_FEATURES.values())
_FARTHEST = 10.0  # the range of a sensor without a limit is observed as this [m]


def context_of(runs: Run, duration: float) -> np.ndarray:
    """The context of each run, (B, `CONTEXT_SIZE`) float32 within [-1, 1].

    In order: half the room's size [10 m], the decimal logarithm of the duration and of the time left [0.5 log10 s],
    of the measurement noise [log10 px], the process noise of translation [m/s²] and rotation [rad/s²] that the filter
    assumes (its logarithm, by half), expected landmarks [200], the prior of inverse depth [1/m], the tangent of half
    the angle of view [2], how far the sensor reaches [10 m], and whether the filter knows the commands.

    Args:
        runs: A batch of runs.
        duration: Time of an episode [s].
    """
    models, steps = runs.models, runs.episode["steps"]
    total = models["task"]["steps"]
    share = np.divide(steps, total, out=np.full(len(steps), np.nan), where=total > 0)  # NaN before the first reset
    motion, lens = models["motion"], models["lens"]
    out = np.empty((len(steps), CONTEXT_SIZE), np.float32)
    out[:, :3] = motion["half"] / 10.0
    columns = (
        np.log10(duration) / 2.0,
        np.log10(1.0 + duration * (1.0 - share)) / 2.0,
        np.log10(lens["pixel_std"]),
        np.log10(motion["filter_acceleration_std"]) / 2.0,
        np.log10(motion["filter_angular_acceleration_std"]) / 2.0,
        runs.expected.shape[1] / 200.0,
        models["filter"]["initialisation"]["rho_mean"],
        lens["u0"] / lens["focal"] / 2.0,
        np.minimum(lens["maximum_distance"], _FARTHEST) / 10.0,
        np.where(motion["command_known"], 1.0, 0.0),
    )
    for index, column in enumerate(columns, start=3):
        out[:, index] = column
    return np.clip(out, -1.0, 1.0)
