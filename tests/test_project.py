"""The project around the code: what an import costs, what is installed, and that the README tells the truth."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def run_elsewhere(code: str, cwd: Path) -> str:
    """What ``code`` prints in a fresh interpreter that does not stand in the clone."""
    done = subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("module", "too_slow"),
    [
        ("activeslam_gym", ["torch", "matplotlib", "stable_baselines3", "scipy.stats", "cv2"]),
        ("activeslam_gym.vision.track", ["torch", "matplotlib", "stable_baselines3", "scipy.stats", "cv2"]),
        ("baselines", ["torch", "matplotlib", "stable_baselines3", "scipy.stats"]),
        ("agents.compare", ["torch", "stable_baselines3"]),  # compare works without them
        ("agents.__main__", ["torch", "stable_baselines3"]),
    ],
)
def test_import_is_light(module: str, too_slow: list[str], tmp_path: Path) -> None:
    code = f"import json, sys, {module}; print(json.dumps([name for name in {too_slow} if name in sys.modules]))"
    assert json.loads(run_elsewhere(code, tmp_path)) == []


def test_opencv_comes_with_its_extra_alone() -> None:
    extras = PYPROJECT["project"]["optional-dependencies"]
    assert [name for name, packages in extras.items() if any("opencv" in one for one in packages)] == ["vision"]
    pulls = [name for name, packages in extras.items() if any(re.search(r"\[.*\bvision\b", one) for one in packages)]
    assert pulls == ["live", "all"], "neither the learners nor the demo may pull it"


def test_viser_comes_with_the_live_page_alone() -> None:
    extras = PYPROJECT["project"]["optional-dependencies"]
    assert [name for name, packages in extras.items() if any("viser" in one for one in packages)] == ["live"]
    assert [name for name, packages in extras.items() if any(re.search(r"\[.*\blive\b", one) for one in packages)] == [
        "all"
    ]


def test_what_is_installed_and_its_version(tmp_path: Path) -> None:
    setuptools = pytest.importorskip("setuptools")
    include = PYPROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    packages = setuptools.find_packages(str(ROOT), include=include)
    assert {package.split(".")[0] for package in packages} == {"activeslam_gym"}
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "activeslam_gym").rglob("*.py")}
    assert {".".join(folder.parts) for folder in folders} == set(packages), "a package without an __init__.py"
    assert (ROOT / "activeslam_gym" / "py.typed").is_file()
    code = "import activeslam_gym, agents, baselines\nfor m in activeslam_gym, agents, baselines: print(m.__file__)"
    assert {Path(line).parents[1] for line in run_elsewhere(code, tmp_path).split("\n") if line} == {ROOT}
    import activeslam_gym

    version = PYPROJECT["project"]["version"]
    assert activeslam_gym.__version__ == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^## .*\b{re.escape(version)}\b", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
