"""The machine, the versions and the code that a number was measured with."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping

from activeslam_gym import BEHAVIOUR
from activeslam_gym.evaluation.code import package_sources, package_versions, processor

SOURCES = ("activeslam_gym", "baselines", "agents.learn")
"""Packages that decide a score, beside the policy's own files."""


def machine() -> str:
    """Processor and number of cores."""
    return f"{processor()}, {os.cpu_count()} cores"


def versions(packages: tuple[str, ...]) -> dict[str, str]:
    """Versions of Python and of these packages."""
    return {"python": platform.python_version()} | package_versions(packages)


def sources() -> dict[str, str]:
    """Digests of `SOURCES`."""
    return {package: package_sources(package) for package in SOURCES}


def code_of(sources: Mapping[str, str]) -> str:
    """One digest of the digests of `SOURCES`."""
    return hashlib.sha256(json.dumps(sources, sort_keys=True).encode()).hexdigest()[:12]


def code() -> str:
    """`BEHAVIOUR` and the digest of the present `SOURCES`, as `check-results` finds them in a page."""
    return f"BEHAVIOUR {BEHAVIOUR}, code {code_of(sources())}"
