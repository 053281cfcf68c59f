"""Generated sections of Markdown pages that people write."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from pathlib import Path

from agents.files import write_text
from agents.machine import machine, versions

PACKAGES = ("activeslam-gym", "gymnasium", "numba", "numpy")


def provenance(command: str) -> str:
    """The command, the day, the machine and the versions, as Markdown."""
    named = ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items())
    return f"```bash\n{command}\n```\n\n{datetime.now(timezone.utc):%Y-%m-%d}; {machine()}; {named}."


def put_section(path: Path, name: str, text: str) -> None:
    """Replace what stands between the marks of section `name` in the file at `path`, or append it with its marks."""
    begin, end = f"<!-- generated: {name} -->", f"<!-- end: {name} -->"
    page = path.read_text(encoding="utf-8") if path.exists() else ""
    section = f"{begin}\n{text.strip()}\n{end}"
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if pattern.search(page):
        page = pattern.sub(lambda _: section, page)
    else:
        page = f"{page.rstrip()}\n\n{section}\n".lstrip()
    write_text(path, page)
