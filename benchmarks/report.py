"""What a part of the benchmark says, and how all of it is written down."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from agents.files import write_json, write_text


@dataclass(frozen=True)
class Bar:
    """A number to reach: of DESIGN section 7 unless ``what`` says otherwise."""

    what: str
    measured: float
    limit: float
    unit: str
    at_least: bool = False
    """Whether ``limit`` is the smallest allowed, and not the largest."""

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit


@dataclass
class Section:
    """One part's figures."""

    title: str
    rows: list[dict[str, Any]] = field(default_factory=list)
    """They share their keys, which are the table's head, with units."""
    bars: list[Bar] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """How it was measured, and what was skipped."""


def write_report(out: Path, command: str, machine: dict[str, Any], sections: list[Section]) -> str:
    """Write ``bench.json`` and ``bench.md`` into ``out``; returns the latter."""
    text = markdown(command, machine, sections)
    bars = [{**asdict(bar), "met": bar.met} for section in sections for bar in section.bars]
    value = {"command": command, "machine": machine, "bars": bars, "sections": [asdict(part) for part in sections]}
    write_json(out / "bench.json", value)
    write_text(out / "bench.md", text)
    return text


def markdown(command: str, machine: dict[str, Any], sections: list[Section]) -> str:
    """The whole report."""
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    lines = [
        "# Benchmark",
        "",
        f"    {command}",
        "",
        f"{machine['processor']}, {machine['cores']} cores; {machine['system']}; Python {machine['python']};",
        f"{packages}.",
        "Each time is a median of several, each ratio is of one run. BLAS has one thread throughout.",
    ]
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
    lines += ["", "## Bars", "", *table(rows)] if rows else []
    for section in sections:
        lines += ["", f"## {section.title}", "", *table(section.rows)]
        for note in section.notes:
            lines += ["", note]
    return "\n".join(lines) + "\n"


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of a Markdown table; nothing for no rows."""
    if not rows:
        return []
    body = ["| " + " | ".join(number(value) for value in row.values()) + " |" for row in rows]
    return ["| " + " | ".join(rows[0]) + " |", "|---" * len(rows[0]) + "|", *body]


def number(value: Any) -> str:
    """Three digits of a float, everything of anything else."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
