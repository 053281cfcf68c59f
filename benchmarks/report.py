"""The figures of a part of the benchmark, and all of them as Markdown."""

import platform
from dataclasses import dataclass, field
from typing import Any

from agents.tools.machine import code, machine, versions
from agents.tools.sections import listed, table

PACKAGES = ("activeslam-gym", "gymnasium", "numba", "numpy", "scipy", "filterpy")


@dataclass(frozen=True)
class Bar:
    """A number that the project set itself."""

    what: str
    measured: float
    limit: float
    unit: str
    at_least: bool = False  # whether ``limit`` is the smallest allowed, and not the largest

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return bool(self.measured >= self.limit if self.at_least else self.measured <= self.limit)


@dataclass
class Section:
    """One part's figures."""

    title: str
    rows: list[dict[str, Any]] = field(default_factory=list)
    """They share their keys, which are the table's head, with units."""
    bars: list[Bar] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # how it was measured, and what was skipped


def provenance(command: str) -> str:
    """The command, the machine, the versions and the code."""
    measured_on = f"{machine()}; {platform.platform()}; {listed(versions(PACKAGES))}, {code()}."
    return f"```bash\n{command}\n```\n\n{measured_on}"


def report(sections: list[Section]) -> str:
    """All figures: the bars and a table for each section."""
    parts = ["Each time is a median of several, each ratio is of one run. BLAS has one thread throughout."]
    parts += [f"## Bars\n\n{bars}"] if (bars := bar_table(sections)) else []
    for section in sections:
        parts += [f"## {section.title}\n\n{markdown(section.rows)}", *section.notes]
    return "\n\n".join(parts) + "\n"


def bar_table(sections: list[Section]) -> str:
    """The table of bars."""
    rows = [
        {
            "bar": bar.what,
            "wanted": f"{'≥' if bar.at_least else '≤'} {number(bar.limit)} {bar.unit}".rstrip(),
            "measured": f"{number(bar.measured)} {bar.unit}".rstrip(),
            "": "met" if bar.met else "**not met**",
        }
        for section in sections
        for bar in section.bars
    ]
    return markdown(rows)


def markdown(rows: list[dict[str, Any]]) -> str:
    """A table of rows that share their keys; nothing for no rows."""
    return table(list(rows[0]), [[number(value) for value in row.values()] for row in rows]) if rows else ""


def number(value: Any) -> str:
    """Three digits of a float, everything of anything else."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
