"""The import arrows: ``agents -> baselines -> activeslam_gym``, and inside the last, truth and belief apart.

The tables below are the architecture; the code under them only reads the files' imports (without running them) and
compares. A new module needs a row: where it stands is a decision.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("activeslam_gym", "baselines", "agents")
GYM = "activeslam_gym"

MATHEMATICS = {"kernels", "config", "geometry", "linalg", "camera", "motion"}

MAY_IMPORT: dict[str, set[str]] = {
    # ground floor, from the bottom; names are inside `activeslam_gym`, and a package may always import itself
    "kernels": set(),
    "config": set(),
    "files": set(),
    "threads": {"config"},
    "geometry": {"kernels"},
    "linalg": {"kernels"},
    "camera": {"kernels", "config"},
    "motion": {"kernels", "config", "geometry", "linalg"},
    "metrics": MATHEMATICS | {"files"},
    "world": MATHEMATICS,
    "slam": MATHEMATICS,
    "information": MATHEMATICS | {"slam.belief", "slam.sight", "slam.kalman"},
    "rendering": {"envs.snapshot"},  # draws a snapshot
    "envs": MATHEMATICS | {"threads", "metrics", "world", "slam", "information", "rendering", "vision"},
    "vision": MATHEMATICS | {"files", "slam", "world.noise"},  # beside envs; of the world the counted noise alone
    "play": {"motion", "rendering"},
    "__main__": {"play", "vision"},
    "__init__": {"config", "motion", "envs"},
}
"""What each module or subpackage of ``activeslam_gym`` may import of ours."""

FLOORS: dict[str, set[str]] = {
    "activeslam_gym": set(),
    "baselines": {"activeslam_gym"},
    "agents": {"baselines", "activeslam_gym"},
}
"""What each package may import of the others."""

NEVER: dict[str, set[str]] = {
    "baselines": {"activeslam_gym.world"},
    "agents.learn.encoder": {"activeslam_gym.world"},
    "agents.pretrained": {"activeslam_gym.world"},
}
"""Exceptions from ``FLOORS``: a policy reads observations and beliefs, never the truth."""

PUBLIC = {"config", "files", "geometry", "information", "metrics", "motion", "rendering", "envs.snapshot"}
"""What the upper floors read of ``activeslam_gym``, beside the names of the package itself."""

BEHIND: dict[str, set[str]] = {"agents.sb3_vec_env": {"envs.episode"}}
"""Exceptions from ``PUBLIC``: the batch for SB3, which takes `infos` apart."""

SLOW_TO_IMPORT = {"torch", "matplotlib", "stable_baselines3", "scipy.stats", "cv2"}
"""Imported inside the functions that use them, in ``activeslam_gym`` and ``baselines``."""

PANELS = "activeslam_gym.rendering.panels"
"""Imports matplotlib at its top, and is itself imported inside the functions that draw."""

DRAWING = {"matplotlib", "PIL", "pygame", "cv2"}
"""Imported by ``activeslam_gym.rendering`` alone within ``activeslam_gym``, inside functions too."""

OPENCV = "activeslam_gym.vision.opencv"
"""The exception: OpenCV, which `vision` reads images with, and says the extra's name where it is missing."""


class Import(NamedTuple):
    """One import: ``importer`` (dotted module) takes ``target`` (dotted, with the imported name) at ``line``."""

    importer: str
    target: str
    line: int
    at_top: bool
    """Runs when the importer is imported: outside functions and ``if TYPE_CHECKING``."""


# --- reading the files ------------------------------------------------------------------------------------------------


def module_name(path: Path) -> str:
    """``activeslam_gym/slam/belief.py`` → ``activeslam_gym.slam.belief``; a package is its ``__init__``."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


SOURCES = {module_name(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))}
MODULES = {name.removesuffix(".__init__") for name in SOURCES}


def is_under(name: str, prefix: str) -> bool:
    return name == prefix or name.startswith(prefix + ".")


def is_under_any(name: str, prefixes: set[str]) -> bool:
    return any(is_under(name, prefix) for prefix in prefixes)


def imports(importer: str, source: str) -> list[Import]:
    """Every import in ``source``, wherever it stands."""
    return list(_imports(ast.parse(source), importer, at_top=True))


def _imports(node: ast.AST, importer: str, at_top: bool) -> Iterator[Import]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            for alias in child.names:
                yield Import(importer, alias.name, child.lineno, at_top)
        elif isinstance(child, ast.ImportFrom):
            # `from . import x` in a.b.c is from a.b, one more dot is one package up; a package's name is a.b.__init__
            home = importer.split(".")[: -child.level] if child.level else []
            base = ".".join([*home, *([child.module] if child.module else [])])
            for alias in child.names:
                yield Import(importer, base if alias.name == "*" else f"{base}.{alias.name}", child.lineno, at_top)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            for part, top in ((child.body, False), (child.orelse, at_top)):
                yield from _imports(ast.Module(part, []), importer, top)
        else:
            is_function = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            yield from _imports(child, importer, at_top and not is_function)


# --- the rules: each answers with what is wrong, or None --------------------------------------------------------------


def unit(module: str) -> str:
    """The row of ``MAY_IMPORT`` for a module of ``activeslam_gym``: the first name under it."""
    inside = module.removeprefix(GYM).removeprefix(".")
    return inside.split(".")[0] or "__init__"


def goes_up_a_floor(found: Import) -> str | None:
    here, there = found.importer.split(".")[0], found.target.split(".")[0]
    if there in PACKAGES and there != here and there not in FLOORS[here]:
        return f"{here} may not import {there}"
    return None


def crosses_a_wall(found: Import, modules: set[str]) -> str | None:
    """Inside ``activeslam_gym``, against ``MAY_IMPORT``."""
    if not (is_under(found.importer, GYM) and is_under(found.target, GYM)):
        return None
    here = unit(found.importer)
    target = found.target  # `from activeslam_gym import x` means the module x, if there is one, and else __init__
    if target.count(".") == 1 and target not in modules:
        target = f"{GYM}.__init__"
    inside = target.removeprefix(GYM + ".")
    if is_under_any(inside, MAY_IMPORT.get(here, set()) | {here}):
        return None
    return f"{here} may not import {inside}"


def reads_the_truth(found: Import) -> str | None:
    for prefix, forbidden in NEVER.items():
        if is_under(found.importer, prefix) and is_under_any(found.target, forbidden):
            return f"{prefix} may not import {found.target}"
    return None


def looks_behind(found: Import, modules: set[str]) -> str | None:
    """Above ``activeslam_gym``, against ``PUBLIC``."""
    target = found.target
    if is_under(found.importer, GYM) or not is_under(target, GYM) or target == GYM:
        return None
    if target.count(".") == 1 and target not in modules:  # a name of the package itself
        return None
    allowed = PUBLIC | BEHIND.get(found.importer, set())
    return None if is_under_any(target.removeprefix(GYM + "."), allowed) else f"{found.importer} looks behind {target}"


def is_slow_at_the_top(found: Import) -> str | None:
    lazy = is_under(found.importer, GYM) or is_under(found.importer, "baselines")
    slow = SLOW_TO_IMPORT | {PANELS if is_under(found.importer, f"{GYM}.rendering") else f"{GYM}.rendering"}
    if found.importer == PANELS:
        slow = slow - {"matplotlib"}
    if lazy and found.at_top and is_under_any(found.target, slow):
        return f"{found.target} belongs inside the function that uses it"
    return None


def draws(found: Import) -> str | None:
    inside = is_under(found.importer, GYM) and not is_under(found.importer, f"{GYM}.rendering")
    if found.importer == OPENCV and is_under(found.target, "cv2"):
        return None
    if inside and is_under_any(found.target, DRAWING):
        return f"only rendering draws, not {found.importer}"
    return None


def wrong(found: Import, modules: set[str]) -> list[str]:
    """Every rule that this import breaks."""
    answers = [
        goes_up_a_floor(found),
        crosses_a_wall(found, modules),
        looks_behind(found, modules),
        reads_the_truth(found),
        is_slow_at_the_top(found),
        draws(found),
    ]
    return [answer for answer in answers if answer]


# --- the tests --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_there(package: str) -> None:
    assert f"{package}.__init__" in SOURCES
    assert any(path.stat().st_size for name, path in SOURCES.items() if is_under(name, package))


@pytest.mark.parametrize("module", SOURCES)
def test_imports_go_down(module: str) -> None:
    path = SOURCES[module]
    found = imports(module, path.read_text(encoding="utf-8"))
    faults = [f"{path.relative_to(ROOT)}:{one.line}: {what}" for one in found for what in wrong(one, MODULES)]
    assert not faults, "\n".join(faults)


def test_every_module_has_a_row() -> None:
    missing = {unit(name) for name in MODULES if is_under(name, GYM)} - set(MAY_IMPORT)
    assert not missing, f"say in MAY_IMPORT where these stand: {sorted(missing)}"


def test_truth_and_belief_meet_in_envs_alone() -> None:
    def meets(allowed: set[str]) -> bool:
        return "world" in allowed and any(is_under(name, "slam") for name in allowed)

    assert {name for name, allowed in MAY_IMPORT.items() if meets(allowed | {name})} == {"envs"}


SECRETS = {
    "baselines": {"truth", "labels", "landmark_errors", "_run", "_runs"},  # nor anything behind an environment
    "agents": {"_run", "_runs"},
}
"""Attributes that a package must not read: what referees may see, and what nobody may who stands outside."""


@pytest.mark.parametrize("module", [name for name in SOURCES if is_under_any(name, set(SECRETS))])
def test_nobody_reads_what_is_not_for_them(module: str) -> None:
    tree, secret = ast.parse(SOURCES[module].read_text(encoding="utf-8")), SECRETS[module.split(".")[0]]
    read = [(node.lineno, node.attr) for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    lines = [f"{attribute} in line {line}" for line, attribute in read if attribute in secret]
    assert not lines, f"{module} reads {', '.join(lines)}"


KNOWN = {GYM, *(f"{GYM}.{name}" for name in MAY_IMPORT), f"{GYM}.slam.belief", f"{GYM}.slam.filter"}


@pytest.mark.parametrize(
    ("importer", "source"),
    [
        ("activeslam_gym.envs.active_slam", "import baselines"),
        ("baselines.greedy", "from agents.learn.encoder import Encoder"),
        ("activeslam_gym.geometry", "from activeslam_gym.config import Scenario"),
        ("activeslam_gym.camera", "from activeslam_gym import motion"),
        ("activeslam_gym.camera", "from . import motion"),
        ("activeslam_gym.camera", "import activeslam_gym"),
        ("activeslam_gym.slam.filter", "from ..world.room import Room"),
        ("activeslam_gym.slam.__init__", "from ..world import room"),
        ("activeslam_gym.slam.filter", "def f():\n    import activeslam_gym.world.room"),
        ("activeslam_gym.world.simulator", "from activeslam_gym.slam.belief import Belief"),
        ("activeslam_gym.slam.filter", "from activeslam_gym.metrics import nees"),
        ("activeslam_gym.slam.filter", "from activeslam_gym.information.entropy import gathered"),
        ("activeslam_gym.information.criteria", "from activeslam_gym.slam.filter import filter_frame"),
        ("activeslam_gym.information.criteria", "from activeslam_gym.slam import belief, filter"),
        ("activeslam_gym.information.candidates", "from activeslam_gym.envs.reward import EVALUATION"),
        ("activeslam_gym.kernels", "from activeslam_gym.config import Scenario"),
        ("activeslam_gym.threads", "from activeslam_gym.kernels import row"),
        ("activeslam_gym.metrics", "from activeslam_gym.world.room import Room"),
        ("activeslam_gym.metrics", "from activeslam_gym.slam.belief import Belief"),
        ("activeslam_gym.__init__", "from .world import Room"),
        ("baselines.greedy", "from activeslam_gym import world"),
        ("activeslam_gym.envs.active_slam", "from activeslam_gym.rendering import draw"),
        ("activeslam_gym.rendering.__init__", "import matplotlib.pyplot as plt"),
        ("activeslam_gym.rendering.window", "from matplotlib import pyplot"),
        ("activeslam_gym.rendering.window", "from activeslam_gym.rendering.panels import MapPanel"),
        ("activeslam_gym.rendering.panels", "import torch"),
        ("activeslam_gym.rendering.panels", "from activeslam_gym.slam.belief import Belief"),
        ("activeslam_gym.rendering.scene", "from activeslam_gym.envs.public import Reads"),
        ("activeslam_gym.metrics", "def f():\n    import matplotlib"),
        ("activeslam_gym.metrics", "from scipy import stats"),
        ("activeslam_gym.metrics", "try:\n    from scipy.stats import chi2\nexcept ImportError:\n    pass"),
        ("activeslam_gym.envs.reward", "class A:\n    import torch"),
        ("activeslam_gym.vision.opencv", "import cv2"),
        ("activeslam_gym.vision.sources", "def read():\n    import cv2"),
        ("activeslam_gym.vision.room.scene", "from activeslam_gym.world.room import Room"),
        ("activeslam_gym.vision.frontend", "from activeslam_gym.envs.public import Reads"),
        ("activeslam_gym.slam.filter", "from activeslam_gym.vision import search"),
        ("baselines.greedy", "import torch.nn as nn"),
        ("agents.study.observer", "from activeslam_gym.slam.belief import POINT"),
        ("agents.compare.command", "from activeslam_gym.envs.simulation import Run"),
        ("agents.compare.command", "from activeslam_gym.envs.episode import info_at"),
    ],
)
def test_a_violation_is_caught(importer: str, source: str) -> None:
    assert any(wrong(found, KNOWN) for found in imports(importer, source))


@pytest.mark.parametrize(
    ("importer", "source"),
    [
        ("agents.compare", "import baselines\nfrom activeslam_gym import metrics\nimport matplotlib"),
        ("baselines.greedy", "from activeslam_gym import Motion\nfrom . import policy"),
        ("activeslam_gym.camera", "import numpy\nfrom . import kernels\nfrom .config import Scenario"),
        ("activeslam_gym.slam.filter", "from .belief import Belief\nfrom ..camera import project"),
        ("activeslam_gym.information.candidates", "from activeslam_gym.slam import belief, kalman, sight"),
        ("activeslam_gym.envs.active_slam", "def render():\n    from activeslam_gym import rendering"),
        ("activeslam_gym.envs.simulation", "from ..world import room\nfrom ..slam import filter"),
        ("activeslam_gym.rendering.picture", "def draw():\n    import matplotlib.pyplot as plt"),
        ("activeslam_gym.rendering.picture", "def draw():\n    from activeslam_gym.rendering import panels"),
        ("activeslam_gym.rendering.panels", "from matplotlib import lines\nfrom activeslam_gym.rendering import scene"),
        ("activeslam_gym.rendering.__init__", "from activeslam_gym.rendering.window import Window"),
        ("activeslam_gym.metrics", "def chi2():\n    from scipy import stats\nfrom scipy import linalg"),
        ("activeslam_gym.metrics", "if TYPE_CHECKING:\n    import torch"),
        ("activeslam_gym.__init__", "from activeslam_gym.envs import ActiveSLAM"),
        ("activeslam_gym.rendering.scene", "if TYPE_CHECKING:\n    from activeslam_gym.envs.snapshot import Snapshot"),
        ("agents.sb3_vec_env", "from activeslam_gym.envs.episode import info_at"),
        ("activeslam_gym.vision.opencv", "def opencv():\n    import cv2"),
        ("activeslam_gym.vision.room.sensor", "from activeslam_gym.world.noise import normals"),
        ("activeslam_gym.vision.frontend", "from activeslam_gym.slam.filter import Filter"),
    ],
)
def test_what_is_allowed_passes(importer: str, source: str) -> None:
    assert not [what for found in imports(importer, source) for what in wrong(found, KNOWN)]
