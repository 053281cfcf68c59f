"""The machine and the versions that a number was measured with."""

import os
import platform
from pathlib import Path

from activeslam_gym.evaluation.code import package_versions


def machine() -> str:
    """Processor and number of cores."""
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
    """Versions of Python and of these packages."""
    return {"python": platform.python_version()} | package_versions(packages)
