#!/usr/bin/env bash
# ap_gym 0.7.0: the environments `LIDARLoc...` ask an agent to find its place on a map by a lidar and odometry. The
# odometry is documented as the movement from the starting position, "exact in these environments". `reset` gives the
# start and the position one array, and the first step moves the position in place. So the start moves along. Only then
# does the position get an array of its own. Nothing warns. All odometry of an episode lacks the first step, and that
# after the first step is zero.
# Law: odometry is the position less the first one. The environment itself tells the true position as the target of the
# prediction.
# Upstream: no issue of github.com/TimSchneider42/active-perception-gym that was found describes it.
# With a first action of zero, the odometry is right.
# Prints the odometry beside the movement for three episodes, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ap-gym==0.7.0' 'gymnasium==1.4.0' 'numpy==2.4.6' \
  'shapely==2.2.0' 'scipy==1.17.1' 'datasets==5.2.0' 'aiohttp==3.14.5' 'pillow==13.0.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import ap_gym  # registers the environments
import gymnasium
import numpy as np

STEPS = 20
print("ap_gym", version("ap_gym"))
ok = True


def episode(name, seed, wait):
    """Movement from the start and odometry [pixels] of an episode, whose first action is zero if ``wait``."""
    env = gymnasium.make(name)
    dataset = env.unwrapped.dataset
    size = np.array((dataset.map_width, dataset.map_height))
    random = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    positions, odometry = [], []
    for i in range(STEPS):
        odometry.append(observation["odometry"] * size)
        action = random.uniform(-0.5, 0.5, 2).astype(np.float32) * (0.0 if wait and i == 0 else 1.0)
        observation, _, _, _, info = env.step({"action": action, "prediction": np.zeros(2, np.float32)})
        positions.append((info["prediction"]["target"] + 1.0) / 2.0 * size)  # before the step
    env.close()
    return np.array(positions) - positions[0], np.array(odometry)


for name, seed in (("LIDARLocRoomsStatic-v0", 0), ("LIDARLocRoomsStatic-v0", 1), ("LIDARLocMazeStatic-v0", 2)):
    moved, odometry = episode(name, seed, False)
    error = np.linalg.norm(moved - odometry, axis=1)[1:]
    first = np.linalg.norm(moved[1])
    print(f"{name}: the first step is {first:.3f} pixels long, the odometry after it {np.linalg.norm(odometry[1]):.3f};"
          f" from then on it is off by {error.min():.3f} to {error.max():.3f}")
    moved_later, odometry_later = episode(name, seed, True)
    later = np.abs(moved_later - odometry_later).max()
    print(f"  after a first action of zero, it is off by up to {later:.1e}")
    ok &= first > 0.1 and np.all(odometry[1] == 0.0) and np.allclose(odometry[1:] + moved[1], moved[1:], atol=1e-4)
    ok &= later < 1e-4 and np.abs(odometry_later).max() > 0.1
sys.exit(not ok)
PY
