#!/usr/bin/env bash
# cpprb 11.0.0: `ReplayBuffer` with `Nstep` stores returns over N steps, each with the observation that follows them.
# `on_episode_end` moves the last N - 1 transitions of an episode into the buffer. Its documentation names the reason:
# an episode may be cut at a certain length, without `done`. For those transitions, `next_obs` should be the episode's
# last observation. It is an array of ones, which no environment has shown. Their `done` is zero, so a learner adds the
# value of that observation to the return. Nothing warns.
# Law: the observation that follows a transition is a later one of the same episode.
# Upstream: no issue of github.com/ymd-h/cpprb that was found describes it.
# Transitions of one step, without `Nstep`, are right. Where an episode ends by `done`, `next_obs` has no use.
# Prints `next_obs` for episodes that show 100, 101, 102, ... and 200, 201, ..., and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'cpprb==11.0.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

from cpprb import ReplayBuffer

STARTS, LENGTH = (100, 200, 300), 6


def stored(steps):
    """Transitions of episodes that are cut after LENGTH steps, as lists for each episode."""
    options = {"Nstep": {"size": steps, "gamma": 1.0, "rew": "rew", "next": "next_obs"}} if steps > 1 else {}
    buffer = ReplayBuffer(100, {name: {} for name in ("obs", "rew", "next_obs", "done")}, **options)
    for start in STARTS:
        for obs in range(start, start + LENGTH):
            buffer.add(obs=obs, rew=1.0, next_obs=obs + 1, done=0.0)
        buffer.on_episode_end()
    columns = buffer.get_all_transitions()
    return {name: column.reshape(len(STARTS), LENGTH).astype(int).tolist() for name, column in columns.items()}


ok = True
for steps in (1, 2, 3, 4):
    found = stored(steps)
    for k, start in enumerate(STARTS):
        print(f"N = {steps}, episode of {found['obs'][k]}: next_obs {found['next_obs'][k]}, done {found['done'][k]}")
        last = start + LENGTH
        due = [min(start + i + steps, last) for i in range(LENGTH)]
        seen = [1 if i > LENGTH - steps else due[i] for i in range(LENGTH)]
        ok &= found["obs"][k] == list(range(start, last)) and found["next_obs"][k] == seen and not any(found["done"][k])
        ok &= found["rew"][k] == [min(steps, LENGTH - i) for i in range(LENGTH)] and (seen == due) == (steps == 1)
sys.exit(not ok)
PY
