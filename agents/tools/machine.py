"""The machine, the versions and the code that a number was measured with."""

import os
import platform
import subprocess
from functools import cache
from pathlib import Path

from activeslam_gym import BEHAVIOUR
from activeslam_gym.evaluation.code import package_versions, processor


def machine() -> str:
    """Processor and number of cores."""
    return f"{processor()}, {os.cpu_count()} cores"


def versions(packages: tuple[str, ...]) -> dict[str, str]:
    """Versions of Python and of these packages."""
    return {"python": platform.python_version()} | package_versions(packages)


@cache
def code() -> str:
    """`BEHAVIOUR` and the commit of the clone, as they stand in a page."""
    line = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--exclude", "*"]
    try:
        commit = subprocess.run(line, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # installed, not cloned
        commit = "unknown"
    return f"BEHAVIOUR {BEHAVIOUR}, commit {commit}"
