"""The import arrows: ``agents -> baselines -> activeslam_gym``, and inside the last, truth and belief apart.

The tables below are the architecture; the code under them only reads the files' imports (without running them) and
compares. A new module needs a row: where it stands is a decision.
"""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

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
    # reads environments through their public surface
    "evaluation": {"files", "registry", "metrics", "motion", "envs.info", "__init__"},
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


FILES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
SOURCES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in FILES}
"""``activeslam_gym.slam.belief`` → its file; a package is its ``__init__``."""
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in SOURCES.items()}
MODULES = {name.removesuffix(".__init__") for name in SOURCES}


def is_under(name: str, *prefixes: str) -> bool:
    return any(name == prefix or name.startswith(prefix + ".") for prefix in prefixes)


def imports(importer: str) -> Iterator[tuple[str, int]]:
    """Each import of a module, wherever it stands: what it takes (dotted, with the imported name), and its line."""
    for node in ast.walk(TREES[importer]):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # `from . import x` in a.b.c is from a.b, one more dot is one package up; a package's name is a.b.__init__
            home = importer.split(".")[: -node.level] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            yield from ((base if alias.name == "*" else f"{base}.{alias.name}", node.lineno) for alias in node.names)


def unit(module: str) -> str:
    """The row of ``MAY_IMPORT`` for a module of ``activeslam_gym``: the first name under it."""
    return module.removeprefix(GYM).removeprefix(".").split(".")[0] or "__init__"


def broken_rules(importer: str, target: str) -> list[str]:
    """Every rule that this import breaks."""
    here, there = importer.split(".")[0], target.split(".")[0]
    # `from activeslam_gym import x` means the module x, if there is one, and else a name of the package itself
    own_name = target.count(".") == 1 and target not in MODULES
    inside = "__init__" if own_name else target.removeprefix(f"{GYM}.")
    rules = {
        "goes up a floor": there in (*PACKAGES, *TOPS) and there not in FLOORS[here] | {here},
        "crosses a wall": here == there == GYM
        and not is_under(inside, unit(importer), *MAY_IMPORT.get(unit(importer), ())),
        "looks behind the package": here != there == GYM
        and not (own_name or target == GYM or is_under(inside, *PUBLIC, *BEHIND.get(importer, ()))),
    }
    return [rule for rule, broken in rules.items() if broken]


def secrets_read(module: str) -> list[str]:
    """Attributes that a ``module`` reads, and must not: the filter's arrays outside ``slam``, and `SECRETS`."""
    found = [node for node in ast.walk(TREES[module]) if isinstance(node, ast.Attribute)]
    secret = {name for package, names in SECRETS.items() if is_under(module, package) for name in names}
    arrays = [] if is_under(module, f"{GYM}.slam") else [
        node for node in found
        if isinstance(node.value, ast.Attribute) and node.value.attr == "ekf"
        or node.attr == "belief" and ast.unparse(node.value).endswith("filter")
    ]  # fmt: skip
    return [f"{module}:{node.lineno}: {ast.unparse(node)}" for node in found if node.attr in secret or node in arrays]


def test_every_package_is_there_and_every_module_has_a_row() -> None:
    assert {f"{package}.__init__" for package in PACKAGES} <= set(SOURCES)
    missing = {unit(name) for name in MODULES if is_under(name, GYM)} - set(MAY_IMPORT)
    assert not missing, f"say in MAY_IMPORT where these stand: {sorted(missing)}"
    both = [name for name, allowed in MAY_IMPORT.items() if {"world", "slam"} <= allowed | {name}]
    assert both == ["envs"], "a sensor sees the truth, and its model reads an `Estimate`; but no estimator"


def test_imports_go_down_without_a_circle() -> None:
    faults, graph = [], {}
    for name in SOURCES:
        module, targets = name.removesuffix(".__init__"), set()
        for target, line in imports(name):
            faults += [f"{name}:{line}, {target}: {rule}" for rule in broken_rules(name, target)]
            targets.add(target if target in MODULES else target.rpartition(".")[0])
        graph[module] = targets & MODULES - {module}
    assert not faults
    TopologicalSorter(graph).prepare()  # an error names the modules of a circle


def test_the_filters_arrays_and_the_ground_truth_are_read_by_those_alone_who_may() -> None:
    assert not [line for name in SOURCES for line in secrets_read(name)]
