"""The project around the code: what an import costs, what is installed, and that the README tells the truth."""

import json
import re
import shutil
import sys
import tarfile
from pathlib import Path

import pytest

from tests.support import python

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LEARNERS = ["torch", "stable_baselines3"]


@pytest.mark.parametrize(("module", "too_slow"), [
    ("activeslam_gym", [*LEARNERS, "matplotlib", "numba", "scipy.stats", "scipy.linalg", "cv2"]),
    ("activeslam_gym.vision.track", [*LEARNERS, "matplotlib", "scipy.stats", "cv2"]),
    ("baselines", [*LEARNERS, "matplotlib", "scipy.stats", "scipy.linalg"]),
    ("agents.compare", LEARNERS),  # compare works without them
    ("agents.__main__", LEARNERS),
])  # fmt: skip
def test_import_is_light(module: str, too_slow: list[str], tmp_path: Path) -> None:
    code = f"import json, sys, {module}; print(json.dumps([name for name in {too_slow} if name in sys.modules]))"
    assert json.loads(python("-c", code, cwd=tmp_path)) == []


def test_the_source_distribution_is_the_package_without_tests(tmp_path: Path) -> None:
    """The tests need `agents`, `baselines` and modules of their own, and run in the clone."""
    pytest.importorskip("setuptools", minversion="77")
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "docs", "results")
    shutil.copytree(ROOT, tmp_path / "clone", ignore=unwanted)
    python("-c", "from setuptools import build_meta; build_meta.build_sdist('..')", cwd=tmp_path / "clone")
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as file:
        held = {Path(*Path(member.name).parts[1:]) for member in file.getmembers() if member.isfile()}
    assert {path.parts[0] for path in held if path.suffix == ".py"} == {"activeslam_gym"}
    ours = {path.relative_to(ROOT) for path in (ROOT / "activeslam_gym").rglob("*.py")}
    assert held >= ours | set(map(Path, ("LICENSE", "README.md", "pyproject.toml", "activeslam_gym/py.typed")))


def test_what_is_installed_and_its_version(tmp_path: Path) -> None:
    setuptools = pytest.importorskip("setuptools")
    include = PYPROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    packages = setuptools.find_packages(str(ROOT), include=include)
    assert {package.split(".")[0] for package in packages} == {"activeslam_gym"}
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "activeslam_gym").rglob("*.py")}
    assert {".".join(folder.parts) for folder in folders} == set(packages), "a package without an __init__.py"
    assert (ROOT / "activeslam_gym" / "py.typed").is_file()
    code = "import activeslam_gym, agents, baselines\nfor m in activeslam_gym, agents, baselines: print(m.__file__)"
    assert {Path(line).parents[1] for line in python("-c", code, cwd=tmp_path).split("\n") if line} == {ROOT}
    import activeslam_gym

    version = PYPROJECT["project"]["version"]
    assert activeslam_gym.__version__ == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^## .*\b{re.escape(version)}\b", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
