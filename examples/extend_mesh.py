"""A flat of three rooms as a triangle mesh: made by trimesh, and flown through. Needs the extra `mesh`."""

import tempfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import trimesh

import activeslam_gym  # noqa: F401  (registers the environments)
import baselines

WIDTH, HEIGHT, DEPTH, DOOR = 8.0, 2.5, 6.0, 1.4  # [m]


def flat() -> trimesh.Trimesh:
    """Two inner walls, each with a door in its middle, make three rooms. Y is up, as glTF has it."""
    side = 0.5 * (DEPTH - DOOR)
    walls = [((WIDTH, 0.1, DEPTH), (0.0, y, 0.0)) for y in (0.0, HEIGHT)]
    walls += [((0.1, HEIGHT, DEPTH), (x, 0.5 * HEIGHT, 0.0)) for x in (-0.5 * WIDTH, 0.5 * WIDTH)]
    walls += [((WIDTH, HEIGHT, 0.1), (0.0, 0.5 * HEIGHT, z)) for z in (-0.5 * DEPTH, 0.5 * DEPTH)]
    for x in (-WIDTH / 6.0, WIDTH / 6.0):
        walls += [((0.1, HEIGHT, side), (x, 0.5 * HEIGHT, z)) for z in (-0.5 * (DOOR + side), 0.5 * (DOOR + side))]
    parts = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in walls]
    return trimesh.util.concatenate(parts)


def main(steps: int = 40) -> Any:
    """Fly `mi-mi` through it; the environment."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "flat.glb")
        flat().export(path)
        env: Any = gym.make("ActiveSLAM-v0", scene=str(path), render_mode="rgb_array")
        observation, _ = env.reset(seed=0)
        policy, state = baselines.make("mi-mi", env), None
        for _ in range(steps):
            action, state = policy.predict(observation, state)
            observation, *_, info = env.step(action)
    print(f"a flat of {env.unwrapped.scenario.room_size} m: {info['landmarks_mapped']} landmarks mapped")
    print(f"log score {info['log_score']:.0f} bits, position error {100 * info['position_error']:.1f} cm")
    return env


if __name__ == "__main__":
    main()
