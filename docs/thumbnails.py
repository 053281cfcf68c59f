"""`python docs/thumbnails.py`: the pictures of the scenario gallery, 4 s into the first training episode of each."""

from pathlib import Path

import gymnasium as gym
from PIL import Image

import activeslam_gym
import baselines
from activeslam_gym.config import IMAGE_SCENARIOS, SCENARIOS, TRAINING_SEED

FOLDER = Path(__file__).resolve().parent / "images" / "scenarios"
TIME = 4.0
"""In the episode [s]."""
SIZE, ROOM = (960, 640), (8, 60, 614, 582)
"""Of a picture [px], and the part of it that shows the room."""
WIDTH = 400
"""Of a picture in the gallery [px]."""


def thumbnail(name: str) -> Image.Image:
    """The room with the map that `mi-mi` has made; of a scenario on images, what the camera sees."""
    images = name in IMAGE_SCENARIOS
    env = gym.make(
        "ActiveSLAMPixels-v0" if images else "ActiveSLAM-v0",
        scenario=name,
        render_mode="rgb_array",
        render_size=SIZE,
    )
    policy = baselines.make("mi-mi", env)
    observation, _ = env.reset(seed=TRAINING_SEED)
    for _ in range(round(TIME / env.unwrapped.scenario.gaze_period)):
        observation, *_ = env.step(policy.predict(observation)[0])
    picture = Image.fromarray(env.unwrapped.image) if images else Image.fromarray(env.render()).crop(ROOM)
    return picture.convert("RGB").resize((WIDTH, WIDTH * picture.height // picture.width), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    activeslam_gym.warm_up()
    for scenario in SCENARIOS:
        thumbnail(scenario).quantize(256, kmeans=1).save(FOLDER / f"{scenario}.png", optimize=True)
