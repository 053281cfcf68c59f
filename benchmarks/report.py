"""What a part of the benchmark says, and how all of it is written down."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from agents.tools.files import write_json, write_text
from agents.tools.sections import listed, put_section
from agents.tools.sections import table as markdown_table


@dataclass(frozen=True)
class Bar:
    """A number that the project set itself."""

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
    text = f"# Benchmark\n\n{markdown(command, machine, sections)}"
    bars = [{**asdict(bar), "met": bar.met} for section in sections for bar in section.bars]
    value = {"command": command, "machine": machine, "bars": bars, "sections": [asdict(part) for part in sections]}
    write_json(out / "bench.json", value)
    write_text(out / "bench.md", text)
    return text


def put_report(page: Path, command: str, machine: dict[str, Any], sections: list[Section]) -> None:
    """Write the report, or its bars alone, into the generated sections "bench" and "speed" of ``page``.

    Raises ValueError if there is no such page.
    """
    put_section(page, "bench", markdown(command, machine, sections))
    bars = [f"```bash\n{command}\n```\n\n{description(machine)}\n", *bar_table(sections)]
    put_section(page, "speed", "\n".join(bars))


def markdown(command: str, machine: dict[str, Any], sections: list[Section]) -> str:
    """The whole report, but for its title."""
    lines = ["```bash", command, "```", "", description(machine)]
    lines.append("Each time is a median of several, each ratio is of one run. BLAS has one thread throughout.")
    bars = bar_table(sections)
    lines += ["", "## Bars", "", *bars] if bars else []
    for section in sections:
        lines += ["", f"## {section.title}", "", *table(section.rows)]
        for note in section.notes:
            lines += ["", note]
    return "\n".join(lines) + "\n"


def description(machine: dict[str, Any]) -> str:
    """What it was measured on, in two lines."""
    where = f"{machine['processor']}, {machine['cores']} cores; {machine['system']}; Python {machine['python']};"
    return f"{where}\n{listed(machine['packages'])}."


def bar_table(sections: list[Section]) -> list[str]:
    """Lines of the table of bars."""
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
    return table(rows)


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of a Markdown table; nothing for no rows."""
    cells = [[number(value) for value in row.values()] for row in rows]
    return markdown_table(list(rows[0]), cells).splitlines() if rows else []


def number(value: Any) -> str:
    """Three digits of a float, everything of anything else."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
