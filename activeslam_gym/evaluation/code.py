"""What a result depends on beside its arguments: versions, digests of files, and a user's own modules."""

import hashlib
import platform
import sys
import sysconfig
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from modulefinder import ModuleFinder
from pathlib import Path

from activeslam_gym import BEHAVIOUR, __version__
from activeslam_gym.registry import REGISTRIES

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


def digest(*paths: Path) -> str:
    """Digest of the contents of files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def own_files(modules: Iterable[str]) -> dict[str, Path]:
    """Files and packages of a user's ``modules``, and of what they import that is not installed: relative path → path.

    Nothing is run. Names that are no such modules are left out.
    """
    homes = [Path(home).resolve() for name, home in sysconfig.get_paths().items() if "lib" in name]
    path = [one for one in sys.path if not any(Path(one).resolve().is_relative_to(home) for home in homes)]
    finder, found = ModuleFinder([one or "." for one in path], excludes=OURS), dict[str, Path]()
    for name in {name for name in modules if name.partition(".")[0] not in OURS}:
        try:
            finder.import_hook(name)
        except AttributeError:  # its folder has no __init__.py, which the finder does not know
            inside = "/".join(name.split(".")) + ".py"
            found.update((inside, Path(one, inside)) for one in path if Path(one, inside).is_file())
        except (ImportError, SyntaxError, ValueError):  # the import itself will tell
            continue
    for name, module in finder.modules.items():
        file = Path(getattr(module, "__file__", None) or "")
        if "." in name and name.partition(".")[0] in found:
            continue
        if file.name == "__init__.py" and "." not in name:
            found[name] = file.parent  # whole, with its data
        elif file.suffix == ".py":
            found["/".join(name.split(".")) + ("/__init__.py" if file.name == "__init__.py" else ".py")] = file
    return found


def foreign_modules() -> set[str]:
    """The modules of registered entries of other packages."""
    entries = [one[name] for one in REGISTRIES for name in one if name not in one.own]
    return {getattr(entry, "__module__", "") for entry in entries} - {"", "__main__"}


def foreign_parts(text: str) -> list[str]:
    """Registered entries of other packages, of those whose names stand in quotes in ``text``: their code may read files
    and use libraries, so results that depend on them are not identified.

    Scenarios are data, which a key holds in full.
    """
    return [
        f"{registry.kind} {name}"
        for registry in REGISTRIES
        for name, entry in registry.items()
        if name not in registry.own and callable(entry) and f'"{name}"' in text
        if getattr(entry, "__module__", "").partition(".")[0] not in COUNTED
    ]
