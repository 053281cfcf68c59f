"""A scenario of your own: a tunnel with a poorer camera, by name everywhere that a scenario is taken."""

import dataclasses

import gymnasium as gym

import baselines
from activeslam_gym import SCENARIOS, Scenario
from activeslam_gym.evaluation import run_episode

tunnel = Scenario(
    name="tunnel",
    room_size=(2.0, 2.0, 12.0),  # X, Y (height), Z [m]
    landmark_count=40,
    pixel_std=3.0,  # [px]
    missed_detection_probability=0.1,
)

env = gym.make("ActiveSLAM-v0", scenario=tunnel)
same = gym.make("ActiveSLAM-v0", scenario=dataclasses.asdict(tunnel))  # what an env spec holds
SCENARIOS[tunnel.name] = tunnel  # from here on, scenario="tunnel" in this process

if __name__ == "__main__":
    run = run_episode(env, baselines.make("mi-fisher", env), seed=1)
    print(f"{run.landmarks_mapped[-1]} of {tunnel.landmark_count} landmarks mapped, lost: {run.lost}")
