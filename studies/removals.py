"""What is added to a module of the package to take one mechanism away: row → module → lines."""

_NEVER = "def {}:\n    return False"


def _never(signature: str) -> str:
    return f"@borrowing\ndef {signature}:\n    return False"


def _constants(function: str, **values: object) -> str:
    """Lines after which the record that ``function`` fills has these ``values``."""
    sets = "".join(f"    out.{name} = {value}\n" for name, value in values.items())
    return f"_filled = {function}\n\n\ndef {function}(scenario):\n    out = _filled(scenario)\n{sets}    return out"


def _association(**values: object) -> dict[str, str]:
    return {"slam/association": _constants("association_of", **values)}


REMOVALS: dict[str, dict[str, str]] = {
    "base": {},
    "chance": {"slam/association": _never("_returns_by_chance(model, sight, detections, of_thing)")},
    "crowded": {
        "slam/association": _never("_is_crowded(model, sight, a, detections, matched, unexplained)"),
        "slam/initialisation": _never("_is_alone(model, detections, i)").replace("False", "True"),
    },
    "twins": {"slam/association": _never("_has_twin(model, things, a)")},
    "vague": {"slam/association": _never("_is_vague(model, sight, a)")},
    "three-rules": {
        "slam/association": "\n\n\n".join(
            [
                _never("_returns_by_chance(model, sight, detections, of_thing)"),
                _never("_is_crowded(model, sight, a, detections, matched, unexplained)"),
                _never("_has_twin(model, things, a)"),
                _never("_is_vague(model, sight, a)"),
            ]
        ),
        "slam/initialisation": _never("_is_alone(model, detections, i)").replace("False", "True"),
    },
    "border": _association(border_margin="-1e9"),
    "margins": _association(missed_margin="out.margin", point_margin="out.margin", point_missed_margin="out.margin"),
    "novelty": _association(novelty="-1e9"),
    "clear": {
        "slam/association": "@borrowing\ndef _match_clear(model, h, things, detections, pair_worth, of_thing):\n"
        "    return False"
    },
    "restarts": {"slam/restart": _constants("restart_of", limit="math.inf")},
    "disproof": {"envs/disproof": "@compiled\ndef disprove(run):\n    pass"},
    "products-once": {"slam/curvature": "PRODUCT_FRAMES, IMAGE_PRODUCT_FRAMES = 1.0, 1.0"},
    "curvature-point": {"slam/curvature": "@borrowing\ndef curvature_of_point(view, P, y, thing, work):\n    pass"},
    "curvature-depth": {"slam/curvature": "@borrowing\ndef curvature_of_inverse_depth(P, rho, thing, work):\n    pass"},
    "iteration": {"slam/correction": "ITERATIONS = 0"},
    "alone": {"slam/initialisation": _never("_is_alone(model, detections, i)").replace("False", "True")},
    "jcbb": {"slam/frame": "from activeslam_gym.slam.jcbb import jcbb as associate  # noqa: E402"},
    "nearest": {"slam/frame": "from activeslam_gym.slam.jcbb import nearest as associate  # noqa: E402"},
}


def _joined(*rows: str) -> dict[str, str]:
    """Several removals at once."""
    modules = dict.fromkeys(module for row in rows for module in REMOVALS[row])
    return {
        module: "\n\n\n".join(REMOVALS[row][module] for row in rows if module in REMOVALS[row]) for module in modules
    }


for _m in (3, 4, 6):
    REMOVALS[f"margin-{_m}"] = _association(margin=_m, missed_margin=_m, point_margin=_m, point_missed_margin=_m)
    REMOVALS[f"three-margin-{_m}"] = _joined("three-rules", f"margin-{_m}")
