"""An occluder of your own: a box in the scenario hides what is behind it; a planner may know of it, or not."""

from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym import Motion, Scenario
from activeslam_gym.camera import hidden

screen = ((-0.2, -1.0, 1.0), (1.0, 1.0, 1.1))  # lowest and highest corner (X, Y up, Z) [m]: ahead, to the left
scenarios = {
    "no screen": Scenario(name="open"),
    "a screen": Scenario(name="screen", boxes=(screen,)),  # hides what is behind it; filter and planner think otherwise
    "a known screen": Scenario(name="known-screen", boxes=(screen,), boxes_known=True),  # they reckon with it
}


def hidden_fiducials(env: Any) -> list[int]:
    """Indices of the fiducials that a box hides from the true camera."""
    truth, boxes = env.unwrapped.truth, np.array(env.unwrapped.scenario.boxes).reshape(-1, 2, 3)
    return [k for k, fiducial in enumerate(truth.fiducials) if hidden(boxes, truth.position, fiducial)]


def main() -> dict[str, float]:
    """Tell what is hidden, and what the planner expects of staying where it is [bit]."""
    expected = {}
    for name, scenario in scenarios.items():
        env = gym.make("ActiveSLAM-v0", scenario=scenario)
        env.reset(seed=0)
        core: Any = env.unwrapped
        expected[name] = float(core.motion_scores()[Motion.STAY])
        print(f"{name}: hides fiducials {hidden_fiducials(env)}; STAY would teach {expected[name]:.1f} bit")
    return expected


if __name__ == "__main__":
    main()
