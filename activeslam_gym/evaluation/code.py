"""What a result depends on beside its arguments: versions, commit, machine, files, and a user's own modules."""

import hashlib
import os
import platform
import re
import subprocess
import sysconfig
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from activeslam_gym import BEHAVIOUR, __version__

LIBRARIES = (
    *("gymnasium", "numba", "numpy", "scipy"),
    *("opencv-python", "opencv-python-headless", "stable-baselines3", "torch"),
)
"""Results depend on these, those of images and of learned policies on the last ones too."""
COUNTED = ("activeslam_gym", "baselines")  # packages that are part of every installation
OURS = (*COUNTED, "agents")


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
    ours = {"activeslam-gym": __version__, "BEHAVIOUR": str(BEHAVIOUR)}
    ours |= {f"code of {name}": package_sources(name) for name in COUNTED}
    return {**ours, "code of agents": package_sources("agents", ("*.py",)), **package_versions(LIBRARIES)}


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


def machine() -> str:
    """Processor and number of cores."""
    return f"{processor()}, {os.cpu_count()} cores"


@cache
def code() -> str:
    """`BEHAVIOUR` and the commit of the clone, as they stand in a page; "-dirty" where its code has changed since.

    Pages and pictures that a study writes do not change what it measures.
    """
    home = Path(__file__).parents[2]
    own, counted = Path(__file__).relative_to(home).as_posix(), ("*.py", *(f"{name}/*.json" for name in COUNTED))

    def answer(*question: str) -> str:
        return subprocess.run(["git", "-C", home, *question], capture_output=True, text=True, check=True).stdout.strip()

    try:
        answer("ls-files", "--error-unmatch", own)  # installed in a clone of something else, it is not one of its files
        commit = answer("rev-parse", "--short", "HEAD")
        commit += "-dirty" * bool(answer("diff", "--name-only", "HEAD", "--", *counted))
    except (OSError, subprocess.CalledProcessError):  # installed, not cloned
        commit = "unknown"
    return f"BEHAVIOUR {BEHAVIOUR}, commit {commit}"


def digest(*paths: Path) -> str:
    """Digest of the contents of files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def own_files(modules: Iterable[str]) -> dict[str, Path]:
    """The packages or single files of a user's ``modules`` that are not installed: their names → their paths."""
    homes = [Path(home).resolve() for name, home in sysconfig.get_paths().items() if "lib" in name]
    found = {}
    for name in {name.partition(".")[0] for name in modules} - {"", *OURS}:
        spec = find_spec(name)  # runs nothing of it
        if spec and (place := next(iter(spec.submodule_search_locations or ()), spec.origin)):
            path = Path(place)
            if path.exists() and not any(path.resolve().is_relative_to(home) for home in homes):
                found[path.name] = path
    return found


_PART = re.compile(r'"(?:scene|sensor|estimator|motion_criterion|reward)": "((?:[^"\\]|\\.)+)"')


def foreign_parts(settings: str) -> set[str]:
    """A user's own parts in the JSON of an environment's settings: all that are no name and no module of the package.

    Their code may read files and use libraries, and a mesh is a file, so results of them are not identified.
    """
    given = _PART.findall(settings)
    return {one for one in given if not re.fullmatch(r"[\w-]+", one) and one.partition(".")[0] not in COUNTED}


def foreign_modules(settings: str) -> set[str]:
    """The modules of those parts that are 'package.module:name'."""
    named = (part.partition(":") for part in foreign_parts(settings))
    return {module for module, colon, _ in named if colon and module.replace(".", "_").isidentifier()}
