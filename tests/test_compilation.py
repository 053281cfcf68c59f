"""The kernels' cache: a place that cannot be written costs time and no more, and an edit is never overlooked."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config, njit
from numba.core import event
from numba.core.errors import TypingError

from activeslam_gym import compilation
from activeslam_gym.compilation import kernel, part

PACKAGE = Path(compilation.__file__).parent
SMALL_KERNEL = """
import numpy as np
from activeslam_gym.geometry import skew
print(skew(np.ones(3)).tolist())
"""


@part
def double(x: float) -> float:
    """A part."""
    return 2.0 * x


@kernel
def quadruple(x: float) -> float:
    """A kernel of parts."""
    return double(double(x))


def run(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """``code`` in a fresh process in ``folder``, from which it imports."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    command = [sys.executable, "-B", "-c", code]
    return subprocess.run(command, cwd=folder, env={**kept, **environment}, capture_output=True, text=True, check=False)


def test_a_part_is_called_from_kernels_and_from_python() -> None:
    assert (double(1.5), quadruple(1.5)) == (3.0, 6.0)
    assert double.__doc__ == "A part."


@pytest.fixture
def read_only(tmp_path: Path) -> Path:
    """A copy of the package beside which nothing can be cached, not even by root: its __pycache__ are files."""
    copy = tmp_path / PACKAGE.name
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (copy, *(path for path in copy.iterdir() if path.is_dir())):
        (folder / "__pycache__").touch()
    return tmp_path


@pytest.mark.skipif(os.name != "posix", reason="a home that cannot be written is made the POSIX way")
@pytest.mark.parametrize("chosen", [{}, {"NUMBA_CACHE_DIR": "/dev/null/nowhere"}])
def test_without_a_place_for_the_cache_it_works_and_says_what_to_do(read_only: Path, chosen: dict[str, str]) -> None:
    nowhere = {"HOME": "/dev/null/nowhere", "XDG_CACHE_HOME": "/dev/null/nowhere"}
    done = run(SMALL_KERNEL, read_only, **nowhere, **chosen)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]"
    (line,) = done.stderr.splitlines()
    assert "set NUMBA_CACHE_DIR to a directory that can" in line


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_a_read_only_install_caches_where_it_is_told(read_only: Path, tmp_path: Path) -> None:
    cache = str(tmp_path / "cache")
    first, second = (run(SMALL_KERNEL, read_only, NUMBA_CACHE_DIR=cache) for _ in range(2))
    assert first.stdout == second.stdout and first.returncode == 0
    assert "kept for the next time" in first.stderr
    assert second.stderr == ""
    source = read_only / PACKAGE.name / "linalg.py"  # another module than the kernel's own
    source.write_text(source.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert "compiling" in run(SMALL_KERNEL, read_only, NUMBA_CACHE_DIR=cache).stderr


# While kernels are compiled -----------------------------------------------------------------------------------------

compiles = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")


@compiles
def test_the_collector_rests_while_something_is_compiled_and_no_longer() -> None:
    collecting = []

    class Witness(event.Listener):
        def on_start(self, event: event.Event) -> None:
            collecting.append(gc.isenabled())

        def on_end(self, event: event.Event) -> None:
            pass

    with event.install_listener("numba:compile", Witness()):
        assert njit(lambda x: x + 1)(1) == 2
        with pytest.raises(TypingError):
            njit(lambda x: x.absent)(1)
    assert collecting and not any(collecting)
    assert gc.isenabled()


@compiles
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_child_forked_during_a_compilation_collects_garbage() -> None:
    statuses = []

    class Forking(event.Listener):
        def on_start(self, event: event.Event) -> None:
            child = os.fork()
            if child == 0:
                os._exit(0 if gc.isenabled() else 1)
            statuses.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))

        def on_end(self, event: event.Event) -> None:
            pass

    with event.install_listener("numba:compile", Forking()):
        njit(lambda x: x + 2)(1)
    assert set(statuses) == {0}


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module of that name, whose ``main`` leaves a file ``done`` beside it."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(compilation, "available_cores", lambda: 2)
    monkeypatch.setattr(compilation._Cache, "missing", False)
    module = tmp_path / "beside.py"
    module.write_text("from pathlib import Path\ndef main(): Path(__file__).with_name('done').touch()\n")
    return module


@compiles
def test_a_second_process_runs_when_its_kernel_is_compiled(beside: Path) -> None:
    small = njit(lambda x: x + 3)
    second = compilation.SecondProcess(small, "beside")
    second.wait()
    assert not beside.with_name("done").exists()
    assert small(1) == 4
    second.wait()
    assert beside.with_name("done").exists()


@compiles
def test_a_second_process_that_hangs_is_given_up(beside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beside.write_text("import time\ndef main(): time.sleep(600)\n")
    monkeypatch.setattr(compilation.SecondProcess, "_GRACE", 0.0)
    small = njit(lambda x: x + 4)
    second = compilation.SecondProcess(small, "beside")
    small(1)
    process = second._process
    second.wait()
    assert process is not None and process.returncode is not None and second._process is None
