"""The study's figures as tables, for the terminal and in Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from agents.summary import ERRORS, FEW_ROOMS, LEARNED, PAIRED, SPEED, Column, Summary, by_log_score
from agents.tools import sections
from agents.tools.statistics import LEGEND, Estimate


@dataclass(frozen=True)
class Table:
    """A title, the header, and rows of text as long as the header."""

    title: str
    header: list[str]
    rows: list[list[str]]


HONESTY = (
    Column("position_nees", "position", digits=2),
    Column("position_nees_median", "median", digits=2),
    Column("orientation_nees", "orientation", digits=2),
    Column("orientation_nees_median", "median", digits=2),
    Column("landmark_nees", "landmarks", digits=2),
    Column("landmark_nees_median", "median", digits=2),
)


def tables(summary: Summary) -> list[Table]:
    """All tables of the study, by what they answer."""
    figures = summary.policies
    target = summary.settings.get("target_landmarks", "N")
    speed = [replace(column, title=column.title.format(target=target)) for column in SPEED]
    star = "*" if min(f["bits"].rooms for f in figures.values()) < FEW_ROOMS else ""
    result = [
        _table(f"What was learned{star}", figures, LEARNED),
        _table(f"Errors at the end{star}", figures, ERRORS),
        _table(f"{target} landmarks mapped, and the price of a decision{star}", figures, speed),
    ]
    for time in next(iter(summary.honesty.values())):
        at_time = {name: times[time] for name, times in summary.honesty.items()}
        title = f"ANEES per degree of freedom over the runs alive at {time} s (1 is honest){star}"
        result.append(_table(title, at_time, HONESTY, with_median=True))
    if summary.shares:
        rows = [[name, share.text(100.0, 0), str(share.rooms)] for name, share in summary.shares.items()]
        title = f"Share of the planner's lead over the best constant in the log score{star}"
        result.append(Table(title, ["policy", "share, % (of IQMs)", "rooms"], rows))
    for against, differences in summary.paired.items():
        best = ", the baseline with the most bits," if against == summary.best_baseline else ""
        result.append(_table(f"Difference to {against}{best} in the same rooms{star}", differences, PAIRED))
    return result


def text(summary: Summary) -> str:
    """The first table in aligned plain text, with the notes."""
    first = tables(summary)[0]
    return "\n\n".join([f"{first.title}\n{aligned(first)}", LEGEND, *summary.notes])


def markdown(summary: Summary) -> str:
    """The same in Markdown."""
    parts = [f"### {table.title.replace('*', chr(92) + '*')}\n\n{pipes(table)}" for table in tables(summary)]
    notes = [note.replace("* ", "\\* ", 1) for note in summary.notes]
    return "\n\n".join(["## Comparison", *parts, LEGEND, *notes]) + "\n"


def headline(summary: Summary) -> str:
    """One Markdown table, the highest log score first."""
    figures = {name: summary.policies[name] for name in by_log_score(summary.policies)}
    return f"{pipes(_table('', figures, (*LEARNED, ERRORS[0])))}\n\n{LEGEND}"


def _table(
    title: str, figures: dict[str, dict[str, Estimate]], columns: Sequence[Column], with_median: bool = False
) -> Table:
    """A row per policy, a column per figure; the header says which statistic it is (unless it is a median beside)."""
    some = next(iter(figures.values()))
    header = ["policy", *(titled(column, some[column.key], with_median) for column in columns), "rooms"]
    rows = [[name, *shown(figure, columns), str(figure[columns[0].key].rooms)] for name, figure in figures.items()]
    return Table(title, header, rows)


def shown(figures: dict[str, Estimate], columns: Sequence[Column]) -> list[str]:
    """The figures of these columns."""
    return [figures[column.key].text(column.scale, column.digits) for column in columns]


def titled(column: Column, figure: Estimate, with_median: bool = False) -> str:
    """The column's title with its statistic."""
    return column.title if with_median or figure.statistic == "share" else f"{column.title} ({figure.statistic})"


def aligned(table: Table) -> str:
    """Columns of equal width, names to the left and figures to the right."""
    lines = [table.header, *table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.header))]
    cells = ([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:]))] for line in lines)
    return "\n".join("  ".join(line) for line in cells)


def pipes(table: Table) -> str:
    """A Markdown table."""
    return sections.table(table.header, table.rows, "| --- |" + " ---: |" * (len(table.header) - 1))
