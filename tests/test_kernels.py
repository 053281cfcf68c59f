"""Kernels: compiled before they are needed, kept where there is a place for them, and an edit is never overlooked."""

import ast
import gc
import importlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numba import config
from numba.core.errors import TypingError

from activeslam_gym import geometry, kernels, linking
from activeslam_gym.envs import compiling

PACKAGE = Path(kernels.__file__).parent
SMALL_KERNEL = """
import numpy as np
from activeslam_gym.geometry import skew
print(skew(np.ones(3)).tolist())
"""
PRINTED = "[[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]"

compiles = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")


def run(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """``code`` in a fresh process in ``folder``, from which it imports."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTHONPATH"))}
    command = [sys.executable, "-B", "-c", code]
    return subprocess.run(command, cwd=folder, env={**kept, **environment}, capture_output=True, text=True, check=False)


def said(folder: Path, **environment: str) -> str:
    """What a process of a small kernel says, which works."""
    done = run(SMALL_KERNEL, folder, **environment)
    assert (done.returncode, done.stdout.strip()) == (0, PRINTED), done.stderr
    return done.stderr


def modules_with_kernels() -> list[ModuleType]:
    """Those whose content the cache's folder is named after."""
    paths = [path for path in sorted(PACKAGE.rglob("*.py")) if any(s in path.read_bytes() for s in linking._SIGNS)]
    return [importlib.import_module(".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts)) for p in paths]


def compiled_functions(module: ModuleType) -> Iterator[Any]:
    """The Python functions of a module that are compiled."""
    for value in vars(module).values():
        function = getattr(value, "py_func", getattr(value, "__wrapped__", None))  # of `inlined`, of `compiled`
        if function is not None and function.__module__ == module.__name__:
            yield function


def homes(module: ModuleType) -> dict[str, str]:
    """From which module each name that a module imports comes."""
    tree = ast.parse(Path(str(module.__file__)).read_text("utf-8"))
    found = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: str(node.module) for node in found for alias in node.names}


@compiles
def test_what_is_compiled_into_kernels_stands_in_modules_with_kernels() -> None:
    """A number of another module would be compiled in, and a change of it overlooked by the cache."""
    modules = modules_with_kernels()
    hashed, functions, wrong = {module.__name__ for module in modules}, 0, []
    for module in modules:
        home = homes(module)
        for function in compiled_functions(module):
            functions += 1
            for name in set(function.__code__.co_names) & set(vars(module)):
                value, where = vars(module)[name], home.get(name, module.__name__)
                if isinstance(value, ModuleType):
                    where = value.__name__
                is_constant = isinstance(value, (int, float, tuple, np.generic, ModuleType))
                if is_constant and where.startswith(PACKAGE.name) and where not in hashed:
                    wrong.append(f"{function.__module__}.{function.__qualname__}: {name} of {where}")
    assert functions > 150
    assert not wrong, "\n".join(wrong)


@pytest.fixture
def read_only(tmp_path: Path) -> Path:
    """A folder with a copy of the package beside which nothing can be cached, not even by root."""
    package = tmp_path / PACKAGE.name
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(path for path in package.iterdir() if path.is_dir())):
        (folder / "__pycache__").touch()
    return tmp_path


@pytest.mark.skipif(os.name != "posix", reason="a home that cannot be written is made the POSIX way")
@pytest.mark.parametrize("chosen", [{}, {"NUMBA_CACHE_DIR": "/dev/null/nowhere"}])
def test_without_a_place_for_the_cache_it_works_and_says_what_to_do(read_only: Path, chosen: dict[str, str]) -> None:
    nowhere = {"HOME": "/dev/null/nowhere", "XDG_CACHE_HOME": "/dev/null/nowhere"}
    (line,) = said(read_only, **nowhere, **chosen).splitlines()
    assert "set NUMBA_CACHE_DIR to a directory that can" in line


@compiles
def test_an_edit_of_a_module_with_kernels_has_a_cache_of_its_own(read_only: Path, tmp_path: Path) -> None:
    """Told where, a read-only install caches there; other modules do not matter, nor does the way to a content."""
    folder, there = read_only, {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    (announcement,) = said(folder, **there).splitlines()
    assert "kept for the next time" in announcement
    assert said(folder, **there) == ""
    drawing = folder / PACKAGE.name / "rendering" / "picture.py"
    drawing.write_text(drawing.read_text("utf-8") + "\n", encoding="utf-8")
    assert said(folder, **there) == ""
    source = folder / PACKAGE.name / "linalg.py"  # another module than the kernel's own
    old = source.read_text("utf-8")
    source.write_text(old + "\n", encoding="utf-8")
    assert "compiling" in said(folder, **there) and said(folder, **there) == ""
    source.write_text(old, encoding="utf-8")  # later than before
    os.utime(source, (1e9, 1e9))
    assert said(folder, **there) == ""
    assert len({path.parent for path in (tmp_path / "cache").rglob("kernels-*/*.nbc")}) == 2


@compiles
def test_a_compilation_that_failed_or_beside_another_leaves_the_settings_as_they_were() -> None:
    level = config.OPT
    with pytest.raises(TypingError):
        geometry.skew("no vector")
    assert gc.isenabled() and config.OPT == level
    with ThreadPoolExecutor(1) as pool, kernels._compiling():
        other = pool.submit(geometry.skew, np.ones(3, np.float32))
        time.sleep(0.1)
    assert other.result().shape == (3, 3) and gc.isenabled() and config.OPT == level


def test_no_kernel_lets_the_compiler_reorder_sums() -> None:
    """It did so in the search of images, in another way on each type of processor."""
    found = [path.name for path in PACKAGE.rglob("*.py") if "fastmath=True" in path.read_text(encoding="utf-8")]
    assert not found


def test_a_process_that_fails_is_an_error_with_its_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "false")
    with pytest.raises(RuntimeError, match="the kernels of steps could not be compiled"):
        compiling.compile_all([compiling.steps])


def test_scores_need_no_kernel_after_warming_up(tmp_path: Path) -> None:
    script = "import activeslam_gym as a; a.warm_up(); e = a.ActiveSLAMEnv(); e.reset(seed=0); e.motion_scores()"
    again = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "compiling" not in again.stderr
