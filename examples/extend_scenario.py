"""A scenario of your own: a corridor with a poorer camera, by name everywhere that a scenario is taken."""

from __future__ import annotations

import dataclasses

import gymnasium as gym

import baselines
from activeslam_gym import SCENARIOS, Scenario

# --8<-- [start:fields]
corridor = Scenario(
    name="corridor",
    room_size=(2.0, 2.0, 12.0),  # X, Y (height), Z [m]
    landmark_count=40,
    pixel_std=3.0,  # [px]
    missed_detection_probability=0.1,
)
# --8<-- [end:fields]

# --8<-- [start:use]
env = gym.make("ActiveSLAM-v0", scenario=corridor, gaze_period=0.25)
same = gym.make("ActiveSLAM-v0", scenario=dataclasses.asdict(corridor), gaze_period=0.25)  # what an env spec holds
SCENARIOS[corridor.name] = corridor  # from here on, scenario="corridor" in this process
# --8<-- [end:use]

if __name__ == "__main__":
    policy = baselines.make("mi-fisher", env)
    observation, info = env.reset(seed=1)
    over = False
    while not over:
        action, _ = policy.predict(observation)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    print(f"{info['landmarks_mapped']} of {corridor.landmark_count} landmarks mapped, lost: {info['lost']}")
