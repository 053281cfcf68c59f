"""Digests of what results depend on: source files, weights, registered entries, and versions of libraries."""

import ast
import hashlib
import platform
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import metadata
from importlib.machinery import PathFinder
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any
from uuid import uuid4

from activeslam_gym import BEHAVIOUR, __version__
from activeslam_gym.registry import REGISTRIES

LIBRARIES = ("gymnasium", "numba", "numpy", "scipy")  # every result depends on these
IMAGE_LIBRARIES = ("opencv-python", "opencv-python-headless")  # results from images depend on these too
LEARNING_LIBRARIES = ("stable-baselines3", "torch")  # and those of learned policies on these
COUNTED = ("activeslam_gym", "baselines")
"""Packages that `module_sources` leaves out, since their digests are part of every key that needs them."""


@cache
def package_versions(packages: tuple[str, ...]) -> dict[str, str]:
    """Versions of these packages, or "not installed"."""
    found = {name: next(iter(metadata.distributions(name=name)), None) for name in packages}
    return {name: one.version if one else "not installed" for name, one in found.items()}


@cache
def package_sources(package: str, patterns: tuple[str, ...] = ("*.py", "*.json")) -> str:
    """Digest of the Python and JSON files of a package."""
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    home = Path(spec.origin).parent
    return digest(*sorted(path for pattern in patterns for path in home.rglob(pattern)))


@cache
def installation() -> dict[str, str]:
    """What results depend on and has to be the same on every machine of a cluster, by name."""
    libraries = package_versions((*LIBRARIES, *IMAGE_LIBRARIES, *LEARNING_LIBRARIES))
    ours = {"activeslam-gym": __version__, "BEHAVIOUR": str(BEHAVIOUR)}
    ours |= {f"code of {name}": package_sources(name) for name in COUNTED}
    return {**ours, "code of agents": package_sources("agents", ("*.py",)), **libraries}


def processor() -> str:
    """The processor's name, with its family and model where they are known, or "unknown"."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    fields = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    name = fields.get("model name") or platform.processor() or "unknown"
    known = {"cpu family", "model"} <= fields.keys()
    return name + (f" (family {fields['cpu family']}, model {fields['model']})" if known else "")


@cache
def module_sources(module: str) -> str:
    """Digest of a module's source and of the modules that it imports, without installed ones and those of `COUNTED`.

    For an installed module: of its whole package. It is taken once in a process, as the module is imported once. A
    module without a source equals no other. What ``python -m`` runs is "__main__", and known by its own name too.
    """
    if module == "__main__" and (spec := sys.modules[module].__spec__):
        module = spec.name
    top = module.partition(".")[0]
    if (origin := _origin(top)) and _is_installed(origin):
        return package_sources(top) if origin.name == "__init__.py" else digest(origin)
    files = _own_modules(module)
    return digest(*dict.fromkeys(files[name] for name in sorted(files))) if module in files else uuid4().hex


def own_files(modules: Iterable[str]) -> dict[str, Path]:
    """Files and packages of these modules and of what they import that are not installed: relative path → path here."""
    found: dict[str, Path] = {}
    for name, path in {name: path for one in modules for name, path in _own_modules(one, "agents").items()}.items():
        top = name.partition(".")[0]
        home = _origin(top)
        if home and home.name == "__init__.py":
            found[top] = home.parent  # whole, with its data
        else:
            found["/".join(name.split(".")) + ("/__init__.py" if path.name == "__init__.py" else ".py")] = path
    return found


def foreign_modules() -> set[str]:
    """The modules of registered entries of other packages."""
    entries = [one[name] for one in REGISTRIES for name in one if name not in one.own]
    return {getattr(entry, "__module__", "") for entry in entries} - {"", "__main__"}


def _own_modules(module: str, *others: str) -> dict[str, Path]:
    """A module and what it imports, but for what is installed, in `COUNTED` or in ``others``, each with its file."""
    files: dict[str, Path | None] = {"": None}
    names = [module]
    while names:
        name = names.pop()
        if name in files or name.partition(".")[0] in (*COUNTED, *others):
            continue
        path = _origin(name)
        files[name] = path if path and path.suffix == ".py" and not _is_installed(path) else None
        names += [name.rpartition(".")[0], *_imports(name, files[name])]
    return {name: path for name, path in files.items() if path}


def is_own_module(name: str) -> bool:
    """Whether a module of this name has a source that `module_sources` reads, and is not installed."""
    path = _origin(name) if name.replace(".", "").isidentifier() and name.partition(".")[0] not in COUNTED else None
    return path is not None and path.suffix == ".py" and not _is_installed(path)


def foreign_parts(text: str) -> list[str]:
    """Registered entries of other packages, of those whose names stand in quotes in ``text``: their code may read files
    and use libraries, so results that depend on them are not identified.

    Scenarios are data, which a key holds in full.
    """
    return [
        f"{registry.kind} {name}"
        for registry in REGISTRIES
        for name, entry in registry.items()
        if name not in registry.own and callable(entry) and f'"{name}"' in text and not _is_counted(entry)
    ]


def _is_counted(entry: Any) -> bool:
    return getattr(entry, "__module__", "").partition(".")[0] in COUNTED


def digest(*paths: Path) -> str:
    """Digest of the contents of files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def _imports(module: str, path: Path | None) -> Iterator[str]:
    """Names that may be modules, in the import statements of a ``module`` whose file is ``path``."""
    package = module if path and path.name == "__init__.py" else module.rpartition(".")[0]
    try:
        tree = ast.parse(path.read_bytes() if path else b"")
    except (SyntaxError, ValueError):  # told by the import itself
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            try:
                base = resolve_name("." * node.level + (node.module or ""), package)
            except ImportError:  # beyond the top-level package
                continue
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _origin(name: str) -> Path | None:
    """File of a module, which is not imported; None: it is built in, a folder without ``__init__.py``, or no module."""
    first, *rest = name.split(".")
    spec = find_spec(first) if first not in ("", "__main__") else None
    for part in rest:
        if spec is None or spec.submodule_search_locations is None:
            return None
        spec = PathFinder.find_spec(f"{spec.name}.{part}", spec.submodule_search_locations)
    return Path(spec.origin) if spec and spec.origin and spec.has_location else None


def _is_installed(path: Path) -> bool:
    homes = [Path(home).resolve() for name, home in sysconfig.get_paths().items() if "lib" in name]
    return any(path.resolve().is_relative_to(home) for home in homes)
