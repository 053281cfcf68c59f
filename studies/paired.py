"""Two versions in the same episodes: paired differences, with 95 % bootstrap intervals over episodes.

Failures in points, the ratio of the interquartile means of the log score, the growth of the number of episodes with a
negative log score, and the medians of the NEES of position and landmarks at the end.
"""

from collections.abc import Iterable

import numpy as np

FIGURES = ("episodes", "base_lost", "lost", "lost_low", "lost_high", "score", "score_low", "score_high", "under_zero",
           "base_pose_nees", "pose_nees", "base_landmark_nees", "landmark_nees")  # fmt: skip


def compare(base: Iterable[dict[str, str]], other: Iterable[dict[str, str]]) -> dict[str, dict[str, float]]:
    """Scenario → `FIGURES` of ``other`` against ``base``, over the episodes of both."""
    first = {(one["scenario"], one["policy"], one["seed"]): one for one in base}
    pairs: dict[str, list[tuple[dict[str, str], dict[str, str]]]] = {}
    for one in other:
        if (key := (one["scenario"], one["policy"], one["seed"])) in first:
            pairs.setdefault(one["scenario"], []).append((first[key], one))
    return {scenario: _differences(found) for scenario, found in pairs.items()}


def _differences(pairs: list[tuple[dict[str, str], dict[str, str]]]) -> dict[str, float]:
    from scipy.stats import bootstrap, trim_mean

    def both(name: str) -> np.ndarray:
        return np.array([[float(one[name]) for one in pair] for pair in pairs]).T

    def points(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return 100.0 * (other - base).mean(axis=axis)

    def ratio(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return trim_mean(other, 0.25, axis=axis) / trim_mean(base, 0.25, axis=axis)

    out = {"episodes": len(pairs), "base_lost": 100.0 * float(both("lost")[0].mean())}
    out["under_zero"] = float(np.diff((both("log_score") < 0.0).sum(axis=1))[0])
    for name, column, figure in (("lost", "lost", points), ("score", "log_score", ratio)):
        ends = bootstrap(both(column), figure, paired=True, n_resamples=2000, method="percentile", random_state=0)
        out[f"{name}_low"], out[f"{name}_high"] = ends.confidence_interval
        out[name] = float(figure(*both(column)))
    for name in ("pose_nees", "landmark_nees"):
        out[f"base_{name}"], out[name] = np.nanmedian(both(name), axis=1)
    return out
