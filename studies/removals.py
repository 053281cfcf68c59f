"""The rows of `studies.worth`: lines that are added to modules of the package, and replace one mechanism each.

A row maps modules of ``activeslam_gym`` to lines. Functions and constants are looked up when kernels are compiled, so a
definition at the end of a module replaces the one above it.
"""


def _answers(signature: str, answer: str) -> str:
    """A kernel with this ``signature`` that always gives the same ``answer``."""
    return f"from activeslam_gym.kernels import compiled\n\n\n@compiled\ndef {signature}:\n    return {answer}"


def _constant(make: str, field: str, value: str) -> str:
    """The function ``make`` of constants, which gives this ``value`` to a ``field``."""
    lines = f"_filled = {make}", "", "", f"def {make}(scenario):", "    out = _filled(scenario)"
    return "\n".join((*lines, f"    out.{field} = {value}", "    return out"))


REMOVALS: dict[str, dict[str, str]] = {
    "base": {},
    # association
    "clear-matches": {"slam/association": _answers("_match_clear(model, h, matches)", "False")},
    "side-by-side": {"slam/association": _constant("association_of", "twin_px", "0.0")},
    "crowded": {"slam/association": _constant("association_of", "crowded", "0")},
    # update
    "iteration": {"slam/kalman": "ITERATIONS = 0"},
    "products-once": {"slam/sight": "PRODUCT_FRAMES, IMAGE_PRODUCT_FRAMES = 1.0, 1.0"},
    "curvature-of-depths": {"slam/sight": _answers("curvature_of_inverse_depth(P, rho, point, D)", "None")},
    # images: scenarios whose names end in "pixels"
    "appearance": {"vision/settings": "SIGHTED = replace(SIGHTED, score_weight=0.0)"},
    "mean-residuals": {"vision/settings": "SIGHTED = replace(SIGHTED, residual_weight=0.0)"},
    "target's-biases": {"vision/settings": "SIGHTED = replace(SIGHTED, fiducial_bias_std=0.0, floor_std=0.03)"},
    "slopes": {"vision/settings": "SIGHTED = replace(SIGHTED, fitted_every=math.inf)"},
    "wander": {"vision/settings": "SIGHTED = replace(SIGHTED, drift=0.0)"},
    "probation": {"vision/settings": "SIGHTED = replace(SIGHTED, probation=1.0)"},
    "half-templates": {"vision/templates": "_LEAST_SEEN = 0.7"},
    # the rest
    "restarts": {"slam/restart": _constant("restart_of", "limit", "math.inf")},
    "disproof": {"envs/disproof": _answers("disprove(run)", "None")},
}
