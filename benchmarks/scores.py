"""What a policy pays for its scores, in the middle of a sweep."""

import numpy as np

from .report import Bar, Section
from .setups import swept
from .timing import repeated


def run(quick: bool) -> Section:
    """Each set of scores, called as a policy calls it."""
    section, env = Section("Scores"), swept(0)
    inner = env.unwrapped
    calls = {
        "7 motion scores": (inner.motion_scores, 0.15),
        "21 joint scores": (inner.joint_scores, 0.4),
        "3 gaze scores": (inner.gaze_scores, None),
        "lookahead, 2 motions": (inner.lookahead_scores, None),
    }
    for name, (call, limit) in calls.items():
        times = 1e3 * repeated(call, 3 if quick else 9, 0.02 if quick else 0.2)
        section.rows.append({"scores": name, "time [ms]": np.median(times), "fastest [ms]": times.min()})
        if limit is not None:
            section.bars.append(Bar(name, float(np.median(times)), limit, "ms"))
    known = f"{len(inner.belief.ids)} features"
    section.notes.append(f"After 20 s of `sweep`, {known}; called from Python, default criteria.")
    env.close()
    return section
