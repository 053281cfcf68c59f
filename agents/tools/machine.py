"""What a number was measured on, and with which versions."""

import hashlib
import os
import platform
import sys
import sysconfig
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from modulefinder import ModuleFinder
from pathlib import Path
from uuid import uuid4

import activeslam_gym
import baselines

RESULTS_REST_ON = ("gymnasium", "numba", "numpy", "scipy")
"""Packages whose versions are written beside results."""


def machine() -> str:
    """Processor and cores, for people."""
    return f"{processor()}, {os.cpu_count()} cores"


def processor() -> str:
    """The processor's name, or "unknown"."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def versions(packages: tuple[str, ...]) -> dict[str, str]:
    """Of these packages and of Python."""
    return {"python": platform.python_version()} | package_versions(packages)


def package_versions(packages: tuple[str, ...]) -> dict[str, str]:
    """Of these packages alone, or "not installed"."""
    found = {name: next(iter(metadata.distributions(name=name)), None) for name in packages}
    return {name: one.version if one else "not installed" for name, one in found.items()}


@cache
def sources() -> str:
    """Digest of the environment and the baselines, their tables among them, on which every episode rests."""
    kinds = ((activeslam_gym, "*.py"), (baselines, "*.py"), (baselines, "*.json"))
    return digest(*(path for home, kind in kinds for path in sorted(Path(str(home.__file__)).parent.rglob(kind))))


@cache
def module_sources(module: str) -> str:
    """Digest of a module's source and of those that it imports, but for what is installed and what `sources` counts.

    Of an installed module: of its whole package. It is taken once in a process, as the module is imported once; one
    without a source is like no other.
    """
    installed = [Path(path) for name, path in sysconfig.get_paths().items() if "lib" in name]
    homes = [path for path in sys.path if not any(Path(path).resolve().is_relative_to(home) for home in installed)]
    finder = ModuleFinder(homes, excludes=["activeslam_gym", "baselines"])
    try:
        finder.import_hook(module)
        return digest(
            *sorted({Path(file) for one in finder.modules.values() if (file := getattr(one, "__file__", ""))})
        )
    except (ImportError, SyntaxError):
        found = find_spec(module.partition(".")[0])
    if not (found and found.origin and found.has_location):
        return uuid4().hex
    origin = Path(found.origin)
    return digest(*(sorted(origin.parent.rglob("*.py")) if found.submodule_search_locations else [origin]))


def digest(*paths: Path) -> str:
    """Of the contents of files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]
