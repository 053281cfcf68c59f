#!/usr/bin/env bash
# ap_gym 0.7.0: in `LIDARLocalization2DEnv`, an agent moves on a map, and slides along the walls that it runs into. Of
# the way that is left at a wall, the library drops the components that are not positive. A single component that stays
# is given to both axes. Nothing warns. So the agent slides along a wall to the right and downwards, and never to the
# left or upwards. If it runs straight into the right wall, what is left of its step takes it downwards, along the wall.
# At the left wall, a slide downwards is cut short by moves off the wall.
# Law: in the mirror image of a room, the mirrored action gives the mirrored motion. In a square room, a step straight
# into the middle of a wall does not move the agent along it, and one to the left slides as far as one to the right.
# Upstream: no issue of github.com/TimSchneider42/active-perception-gym that was found describes it.
# The true position is the target of the prediction.
# Prints the motion along the four walls of a square room, and fails if that changes.
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

import numpy as np
from ap_gym.envs.floor_map import FloorMapDataset
from ap_gym.envs.lidar_localization2d import LIDARLocalization2DEnv

SIDE, STEPS, INTO, ALONG = 21, 5, 0.5, 0.4  # pixels; steps; motion of a step towards the wall and along it [pixels]
print("ap_gym", version("ap_gym"))


class Room(FloorMapDataset):
    """A square room with walls of one pixel."""

    def __init__(self):
        super().__init__(SIDE, SIDE)

    def _get_length(self):
        return 1

    def get_data_point(self, idx):
        room = np.ones((SIDE, SIDE), dtype=bool)
        room[1:-1, 1:-1] = False
        return room

    def get_data_point_batch(self, idx):
        return np.stack([self.get_data_point(i) for i in idx])


def walk(actions):
    """Positions [pixels] before each of the ``actions`` and after the last one."""
    env = LIDARLocalization2DEnv(Room(), static_map=True)
    env.reset(seed=0)
    positions = []
    for action in [*actions, np.zeros(2)]:
        *_, info = env.step({"action": np.asarray(action, np.float32), "prediction": np.zeros(2, np.float32)})
        positions.append((info["prediction"]["target"] + 1.0) / 2.0 * SIDE)
    return np.array(positions)


way = SIDE / 2.0 - walk([])[0]
middle = [way / np.ceil(np.linalg.norm(way))] * int(np.ceil(np.linalg.norm(way)))
ok = True
for name, towards in (("right", (1.0, 0.0)), ("left", (-1.0, 0.0)), ("lower", (0.0, 1.0)), ("upper", (0.0, -1.0))):
    towards = np.array(towards)
    side = np.abs(towards[::-1])  # to the right or downwards
    approach = [*middle, *[towards] * 9, 0.49 * towards]
    found = []
    for along in (-ALONG, 0.0, ALONG):
        path = walk(approach + [INTO * towards + along * side] * STEPS)
        before, after = path[len(approach)], path[-1]
        assert np.allclose(before, SIDE / 2.0 + 9.49 * towards, atol=0.01), before
        found.append(float((after - before) @ side))
    back, straight, on = found
    print(f"{name} wall, {STEPS} steps of {-ALONG:g}, 0 and {ALONG:g} pixels along it: moves by {back:.2f},"
          f" {straight:.2f} and {on:.2f}; expected {-ALONG * STEPS:.2f}, 0.00 and {ALONG * STEPS:.2f}")
    ok &= back > -ALONG * STEPS + 0.5 and (0.5 < on < 1.0 if name == "left" else on > ALONG * STEPS - 0.5)
    ok &= straight > 1.0 if towards.sum() > 0.0 else abs(straight) < 0.1
sys.exit(not ok)
PY
