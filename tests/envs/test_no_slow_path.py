"""No slow path can slip in: what is compiled and allocated is counted, nothing is timed.

Numba warns of slow code where it compiles: there, in `make pytest`, a warning is an error.
"""

import json
from pathlib import Path

import pytest

pytest.importorskip("tyro")

from tests.support import python  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
MOST_ALLOCATIONS = 320
"""Arrays that a step of one frame may ask for: 1.5 times the 213 that it did when this was written."""


ENVIRONMENTS = """
import json, sys
import gymnasium, numpy as np
from numba.core.runtime import rtsys
counts = rtsys.get_allocation_stats
from activeslam_gym.envs.step import step_runs
from activeslam_gym import SCENARIOS
from activeslam_gym.envs.planning import score_runs

def begun(env, seed):
    env.action_space.seed(seed)
    env.reset(seed=seed)
    for _ in range(30):
        env.step(env.action_space.sample())
    inner = env.unwrapped
    for scores in (inner.motion_scores, inner.gaze_scores, inner.joint_scores, inner.lookahead_scores):
        scores()
    return env

box = {"boxes": (((0.0, -1.0, 2.0), (1.0, 0.0, 2.5)),), "boxes_known": True}
for scenario in ("paper", "paper-literal", "clutter", "hall", "hand-held", box):
    begun(gymnasium.make("ActiveSLAM-v0", scenario=scenario), 0)
    begun(gymnasium.make_vec("ActiveSLAMDiscrete-v0", num_envs=3, scenario=scenario, num_threads=2), 0)

allocated, left = {}, {}
for count, scenario in ((1, "paper"), (4, "paper"), (2, "paper-literal"), (2, "hand-held")):
    frame = SCENARIOS[scenario].frame_time
    made = gymnasium.make_vec("ActiveSLAM-v0", num_envs=count, scenario=scenario, gaze_period=frame, num_threads=1)
    env = begun(made, 5)
    before = counts()
    for _ in range(100):
        env.step(env.action_space.sample())
    after = counts()
    left[f"{scenario} {count}"] = (after.alloc - before.alloc) - (after.free - before.free)
    if scenario == "paper":
        allocated[count] = (after.alloc - before.alloc) / (100 * count)
kernels = step_runs.kernel, score_runs.kernel
print(json.dumps({
    "signatures": [len(kernel.signatures) for kernel in kernels],
    "object_mode": [str(s) for kernel in kernels for s, one in kernel.overloads.items() if one.objectmode],
    "allocated": allocated,
    "left": left,
}))
"""


@pytest.fixture(scope="module")
def counted() -> dict:
    """What a fresh process has compiled and allocated after stepping environments of all sorts."""
    return json.loads(python("-c", ENVIRONMENTS, cwd=ROOT, NUMBA_NRT_STATS="1").splitlines()[-1])


def test_one_compiled_step_serves_every_environment_and_allocates_little(counted: dict) -> None:
    """Another signature would be another minute of compilation, or a slow path.

    Every array is freed: a `borrowing` kernel that is given one would keep it for ever.
    """
    assert counted["signatures"] == [1, 1] and counted["object_mode"] == []
    assert all(0 < count < MOST_ALLOCATIONS for count in counted["allocated"].values()), counted["allocated"]
    assert set(counted["left"].values()) == {0}


PARTS = ("scores",)
MORE = "batch", "peers", "images"


@pytest.mark.parametrize("parts", [PARTS, pytest.param(MORE, marks=pytest.mark.slow)])
def test_benchmarks_run(parts: tuple[str, ...], tmp_path: Path) -> None:
    pytest.importorskip("tyro")
    from benchmarks.__main__ import Args, main

    main(Args(parts=parts, quick=True, out=tmp_path))
    measured = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert set(measured) == set(parts) and all(measured.values())
