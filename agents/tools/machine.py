"""What a number was measured on, and with which versions."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib import metadata
from pathlib import Path

import activeslam_gym
import baselines
from agents import pretrained

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
    """Digest of the environment, the baselines and the shipped weights, on which every episode rests."""
    digest = hashlib.sha256()
    for package, pattern in ((activeslam_gym, "*.py"), (baselines, "*.py"), (pretrained, "*.npz")):
        for path in sorted(Path(str(package.__file__)).parent.rglob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
