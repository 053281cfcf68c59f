"""Where the expected landmarks stand: the paper does not say, so the study tries other places."""

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym.config import Scenario

Array = NDArray[np.float64]


def another_draw(scenario: Scenario, seed: int) -> Array:
    """(N, 3) m: uniform in the room again, from a seed of their own."""
    rng = np.random.default_rng([seed, 1])
    return (rng.random((scenario.landmark_count, 3)) - 0.5) * np.array(scenario.room_size)


def lattice(scenario: Scenario, seed: int) -> Array:
    """(N, 3) m: the centres of equal boxes that fill the room, at least N of them; the first N in a random order."""
    side = int(np.ceil(np.cbrt(scenario.landmark_count) - 1e-9))
    centres = (np.arange(side) + 0.5) / side - 0.5
    points = np.stack(np.meshgrid(centres, centres, centres), axis=-1).reshape(-1, 3) * np.array(scenario.room_size)
    return np.random.default_rng([seed, 2]).permutation(points)[: scenario.landmark_count]


def nowhere(scenario: Scenario, seed: int) -> Array:
    """(N, 3) m: where no camera with an upright gaze sees them, hence in no metric; |P| counts them at their prior."""
    return np.tile([0.0, -1000.0, 0.0], (scenario.landmark_count, 1))


PLACES = {"another-draw": another_draw, "lattice": lattice, "nowhere": nowhere}
"""Name → places of the expected landmarks; without a name they stay where the environment drew them."""


class Placed(gym.Wrapper):
    """Moves the expected landmarks after each reset; the room and the noise are the same.

    Raises:
        ValueError: there is no such place.
    """

    def __init__(self, env: gym.Env, place: str) -> None:
        super().__init__(env)
        if place not in PLACES:
            raise ValueError(f"place must be one of {', '.join(PLACES)}, got {place!r}")
        self._place = PLACES[place]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset, with the expected landmarks elsewhere."""
        observation, info = self.env.reset(seed=seed, options=options)
        core: Any = self.env.unwrapped
        core.expect(self._place(core.scenario, seed or 0))
        return observation, info
