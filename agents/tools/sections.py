"""Generated sections of Markdown pages that people write."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path

from agents.tools.files import write_text
from agents.tools.machine import machine, versions

PACKAGES = ("activeslam-gym", "gymnasium", "numba", "numpy")


def provenance(command: str) -> str:
    """The command, the day, the machine and the versions, as Markdown."""
    day = f"{datetime.now(timezone.utc):%Y-%m-%d}"
    return f"```bash\n{command}\n```\n\n{day}; {machine()}; {listed(versions(PACKAGES))}."


def listed(versions: Mapping[str, str]) -> str:
    """Names and versions in a line."""
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def table(header: Sequence[str], rows: Sequence[Sequence[str]], rule: str = "") -> str:
    """A Markdown table; everything to the left, if there is no `rule` under the header."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    return "\n".join([lines[0], rule or "|---" * len(header) + "|", *lines[1:]])


def put_section(path: Path, name: str, text: str) -> bool:
    """Replace what stands between the marks of section `name` in the page at `path`; False where it has no such marks.

    Raises ValueError if there is no such page.
    """
    if not path.is_file():
        raise ValueError(f"report: there is no page {str(path)!r}")
    begin, end = f"<!-- generated: {name} -->", f"<!-- end: {name} -->"
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    page, count = pattern.subn(lambda _: f"{begin}\n{text.strip()}\n{end}", path.read_text(encoding="utf-8"))
    if count:
        write_text(path, page)
    return count > 0
