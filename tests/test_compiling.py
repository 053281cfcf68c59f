"""Kernels that are compiled before they are needed."""

import subprocess
import sys
from pathlib import Path

import pytest

from activeslam_gym.envs import compiling


def test_independent_kernels_are_compiled_by_processes_and_told(capfd: pytest.CaptureFixture[str]) -> None:
    compiling.compile_all([compiling.steps, compiling.scores])
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 2 and "kernels [##]" in lines[-1] and "steps" in lines[-1] and "scores" in lines[-1]


def test_a_process_that_fails_is_an_error_with_its_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "false")
    with pytest.raises(RuntimeError, match="the kernels of steps could not be compiled"):
        compiling.compile_all([compiling.steps])


def test_scores_need_no_kernel_after_warming_up(tmp_path: Path) -> None:
    script = "import activeslam_gym as a; a.warm_up(); e = a.ActiveSLAMEnv(); e.reset(seed=0); e.motion_scores()"
    again = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "compiling" not in again.stderr
