"""The machine, the versions and the code that a number was measured with."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path

from activeslam_gym import BEHAVIOUR
from activeslam_gym.evaluation.code import package_sources, package_versions

SOURCES = ("activeslam_gym", "baselines", "agents.learn")
"""Packages that decide a score, beside the policy's own files."""


def machine() -> str:
    """Processor and number of cores."""
    return f"{processor()}, {os.cpu_count()} cores"


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
