"""Tables, and generated sections of Markdown pages that people write."""

import platform
import re
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from activeslam_gym.evaluation.code import code, machine, package_versions
from agents.tools.files import reading, writable_folder, write_text

PACKAGES = ("activeslam-gym", "gymnasium", "numba", "numpy")


class Table(NamedTuple):
    """A title, the header, and rows of plain text as long as the header."""

    title: str
    header: list[str]
    rows: list[list[str]]

    def aligned(self) -> str:
        """The title over columns of equal width, names to the left and figures to the right."""
        lines = [list(map(in_a_line, cells)) for cells in (self.header, *self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines)]
        cells = ([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:]))] for line in lines)
        return "\n".join([self.title, *("  ".join(line) for line in cells)])

    def markdown(self) -> str:
        """The table in Markdown, without its title; figures to the right. Nothing in a cell is read as markup."""
        header, *rows = (list(map(escaped, cells)) for cells in (self.header, *self.rows))
        return table(header, rows, "| --- |" + " ---: |" * (len(self.header) - 1))


def in_a_line(text: str) -> str:
    """The text in one line, without characters that are not printable."""
    return " ".join("".join(one if one.isprintable() else " " for one in text).split())


def escaped(text: str) -> str:
    """Plain text as Markdown shows it, in a line: nothing in it is markup, HTML, a formula or a mark of a section."""
    special = r"[\\`*<>&{}$~]|\](?=[(\[:])|(?<!\w)_|_(?!\w)"
    return re.sub(special, lambda one: f"&#{ord(one[0])};", in_a_line(text)).replace("|", r"\|")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], rule: str = "") -> str:
    """A table of Markdown; all to the left if there is no `rule` under the header. Bare bars in cells are escaped."""
    lines = ["| " + " | ".join(re.sub(r"(?<!\\)\|", r"\|", one) for one in cells) + " |" for cells in (header, *rows)]
    return "\n".join([lines[0], rule or "|---" * len(header) + "|", *lines[1:]])


def provenance(command: str) -> str:
    """The command, the day, the machine, the versions and the code, as Markdown."""
    versions = ", ".join(f"{name} {version}" for name, version in package_versions(PACKAGES).items())
    day = f"{datetime.now(timezone.utc):%Y-%m-%d}"
    return f"```bash\n{command}\n```\n\n{day}; {machine()}; python {platform.python_version()}, {versions}, {code()}."


def publish(pages: Iterable[Path], name: str, text: str, command: str) -> None:
    """Put a text into the section ``name`` of the pages, under the command that made it."""
    for page in pages:
        put_section(page, name, f"{provenance(command)}\n\n{text}")


def put_section(path: Path, name: str, text: str) -> bool:
    """Replace the text between the marks of section `name` in the page at `path`; False where it has no such marks.

    The text cannot hold a mark: it has no comments. Raises ValueError if there is no such page.
    """
    body = text.strip().replace("<!--", "&lt;!--")
    page, count = _between_marks(name).subn(lambda marks: f"{marks[1]}\n{body}\n{marks[2]}", _text(path))
    if count:
        write_text(path, page)
    return count > 0


def page_with(path: Path, *names: str) -> None:
    """Raise ValueError where there is no such page, or it cannot be written, or has none of these sections."""
    if not any(_between_marks(name).search(_text(path)) for name in names):
        marks = " or ".join(f"<!-- generated: {name} --> … <!-- end: {name} -->" for name in names)
        raise ValueError(f"report: the page {str(path)!r} has no section {marks}")
    writable_folder("report", path.parent)


def _between_marks(name: str) -> re.Pattern[str]:
    return re.compile(f"(<!-- generated: {name} -->).*?(<!-- end: {name} -->)", re.DOTALL)


def _text(path: Path) -> str:
    if not path.is_file():
        raise ValueError(f"report: there is no page {str(path)!r}")
    with reading(path):
        return path.read_text(encoding="utf-8")
