"""The import arrows: ``agents -> baselines -> activeslam_gym``, and inside the last, truth and belief apart.

The tables below are the architecture; the code under them only reads the files' imports (without running them) and
compares. A new module needs a row: where it stands is a decision.
"""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("activeslam_gym", "baselines", "agents")
TOPS = ("studies", "benchmarks")  # import what they like, and are imported by nobody
GYM = "activeslam_gym"

MATHEMATICS = {"kernels", "registry", "config", "geometry", "linalg", "camera", "motion"}

MAY_IMPORT: dict[str, set[str]] = {
    # ground floor, from the bottom; names are inside `activeslam_gym`, and a package may always import itself
    "files": set(),
    "registry": set(),
    "linking": {"files"},
    "kernels": {"linking"},
    "config": {"registry"},
    "threads": {"config"},
    "geometry": {"kernels"},
    "linalg": {"kernels"},
    "motion": {"kernels", "config", "geometry", "linalg"},
    "camera": {"kernels", "config", "geometry", "motion"},
    "metrics": MATHEMATICS | {"files"},
    "world": MATHEMATICS | {"registry"},
    "slam": MATHEMATICS | {"registry"},
    "information": MATHEMATICS | {"slam.estimate", "slam.sight", "slam.kalman"},
    "sensors": MATHEMATICS | {"registry", "world", "slam.estimate", "slam.sight"},  # sees the truth
    "rendering": {"envs.snapshot"},  # draws a snapshot
    "envs": MATHEMATICS | {"threads", "metrics", "world", "sensors", "slam", "information", "rendering", "vision"},
    "vision": MATHEMATICS | {"files", "slam", "world.noise"},  # beside envs; of the world the counted noise alone
    "evaluation": {
        "files",
        "registry",
        "metrics",
        "motion",
        "envs.info",
        "__init__",
    },  # reads environments through their public surface
    "live": MATHEMATICS | {"files", "metrics", "slam", "information", "vision"},
    "__main__": {"vision", "live"},
    "__init__": {"config", "motion", "envs"},
}
"""What each module or subpackage of ``activeslam_gym`` may import of ours."""

FLOORS: dict[str, set[str]] = {
    "activeslam_gym": set(),
    "baselines": {"activeslam_gym"},
    "agents": {"baselines", "activeslam_gym"},
}
"""What each package may import of the others."""

SECRETS = {
    "baselines": {"truth", "labels", "landmark_errors", "_run", "_runs"},  # nor anything behind an environment
    "agents": {"_run", "_runs"},
}
"""Attributes that a package must not read: those for evaluators alone, and those of the environment's inside."""

PUBLIC = {
    *("config", "evaluation", "files", "geometry", "information", "metrics", "motion", "rendering", "live"),
    "envs.snapshot",
}
"""What the upper floors read of ``activeslam_gym``, beside the names of the package itself."""

BEHIND: dict[str, set[str]] = {"agents.sb3": {"envs.info"}}
"""Exceptions from ``PUBLIC``: the batch for SB3, which takes `infos` apart."""


class Import(NamedTuple):
    """One import: ``importer`` (dotted module) takes ``target`` (dotted, with the imported name) at ``line``."""

    importer: str
    target: str
    line: int


FILES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
SOURCES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in FILES}
"""``activeslam_gym.slam.belief`` → its file; a package is its ``__init__``."""
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in SOURCES.items()}
MODULES = {name.removesuffix(".__init__") for name in SOURCES}


def is_under(name: str, *prefixes: str) -> bool:
    return any(name == prefix or name.startswith(prefix + ".") for prefix in prefixes)


def imports(importer: str, text: str) -> Iterator[Import]:
    """Every import in a module's ``text``, wherever it stands."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(importer, alias.name, node.lineno)
        elif isinstance(node, ast.ImportFrom):
            # `from . import x` in a.b.c is from a.b, one more dot is one package up; a package's name is a.b.__init__
            home = importer.split(".")[: -node.level] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            for alias in node.names:
                yield Import(importer, base if alias.name == "*" else f"{base}.{alias.name}", node.lineno)


def unit(module: str) -> str:
    """The row of ``MAY_IMPORT`` for a module of ``activeslam_gym``: the first name under it."""
    return module.removeprefix(GYM).removeprefix(".").split(".")[0] or "__init__"


def wrong(found: Import, modules: set[str]) -> list[str]:
    """Every rule that this import breaks."""
    importer, target = found.importer, found.target
    here, there = importer.split(".")[0], target.split(".")[0]
    # `from activeslam_gym import x` means the module x, if there is one, and else a name of the package itself
    own_name = target.count(".") == 1 and target not in modules
    inside = "__init__" if own_name else target.removeprefix(f"{GYM}.")
    rules = {
        "goes up a floor": there in (*PACKAGES, *TOPS) and there not in FLOORS[here] | {here},
        "crosses a wall": here == there == GYM
        and not is_under(inside, unit(importer), *MAY_IMPORT.get(unit(importer), ())),
        "looks behind the package": here != there == GYM
        and not (own_name or target == GYM or is_under(inside, *PUBLIC, *BEHIND.get(importer, ()))),
    }
    return [f"{importer}:{found.line}, {target}: {rule}" for rule, broken in rules.items() if broken]


def faults(sources: dict[str, str], modules: set[str]) -> list[str]:
    """The rules that the texts of ``sources``, by module, break."""
    return [fault for name, text in sources.items() for one in imports(name, text) for fault in wrong(one, modules)]


def circle(sources: dict[str, str]) -> list[str]:
    """Modules that import each other in a circle, the first one again at the end; ``sources`` are texts by name."""
    modules, graph = {name.removesuffix(".__init__") for name in sources}, {}
    for name, text in sources.items():
        found = list(imports(name, text))
        targets = {one.target if one.target in modules else one.target.rpartition(".")[0] for one in found}
        graph[name.removesuffix(".__init__")] = targets & modules - {name.removesuffix(".__init__")}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def secrets_read(module: str, text: str) -> list[str]:
    """Attributes that a ``module`` reads, and must not: the filter's arrays outside ``slam``, and `SECRETS`."""
    found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)]
    secret = {name for package, names in SECRETS.items() if is_under(module, package) for name in names}
    arrays = [] if is_under(module, f"{GYM}.slam") else [
        node for node in found
        if isinstance(node.value, ast.Attribute) and node.value.attr == "ekf"
        or node.attr == "belief" and ast.unparse(node.value).endswith("filter")
    ]  # fmt: skip
    return [f"{module}:{node.lineno}: {ast.unparse(node)}" for node in found if node.attr in secret or node in arrays]


def test_every_package_is_there_and_every_module_has_a_row() -> None:
    for package in PACKAGES:
        assert f"{package}.__init__" in SOURCES
        assert any(path.stat().st_size for name, path in SOURCES.items() if is_under(name, package))
    missing = {unit(name) for name in MODULES if is_under(name, GYM)} - set(MAY_IMPORT)
    assert not missing, f"say in MAY_IMPORT where these stand: {sorted(missing)}"


def test_imports_go_down_without_a_circle() -> None:
    assert not faults(TEXTS, MODULES)
    assert not circle(TEXTS)


def test_truth_and_estimator_meet_in_envs_alone() -> None:
    """A sensor sees the truth, and its model reads an `Estimate`; but no estimator."""
    reach = {name: allowed | {name} for name, allowed in MAY_IMPORT.items()}
    assert [name for name, all in reach.items() if {"world", "slam"} <= all] == ["envs"]


def test_the_filters_arrays_and_the_ground_truth_are_read_by_those_alone_who_may() -> None:
    assert not [line for name, text in TEXTS.items() for line in secrets_read(name, text)]
