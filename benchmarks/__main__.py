"""`python -m benchmarks`: measure, print, and write `bench.md` and `bench.json`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from threadpoolctl import threadpool_limits

from agents.tools.arguments import command_line
from agents.tools.files import writable_folder, write_json, write_text
from agents.tools.sections import provenance, table
from studies import Page, run

from . import environments, peers
from .against import PAIRS, compare, start

Rows = list[dict[str, Any]]  # they share their keys, which are the table's head, with units
PARTS: dict[str, Callable[[bool], tuple[Rows, str]]] = {
    "batch": environments.batches,
    "images": environments.images,
    "scores": environments.scores,
    "peers": peers.run,
    "start": start,
}
"""Each measures, in small sizes and with few repeats where it is asked to be quick, and says how."""


@dataclass(frozen=True, kw_only=True)
class Args(Page):
    """Measure speed beside peers."""

    section = "bench"
    parts: tuple[Literal["batch", "images", "scores", "peers", "start"], ...] = tuple(PARTS)  # type: ignore
    """Parts to measure."""
    quick: bool = False
    """Use small sizes and few repeats, to see that it runs."""
    out: Path = Path("results/bench")
    """Folder in which bench.md and bench.json are written."""
    against: str | None = None
    """Commit to measure in turn with this checkout, and nothing else (ten minutes)."""

    @classmethod
    def command(cls) -> str:
        """The module to run."""
        return "benchmarks"


def main(args: Args) -> None:
    """Measure the parts, print the tables, and write them."""
    if args.against is not None:
        print(compare(args.against, 1 if args.quick else PAIRS))
        return
    writable_folder("out", args.out)
    with threadpool_limits(1):  # it reaches only the BLAS libraries that are loaded by now, SciPy's own among them
        found = {part: PARTS[part](args.quick) for part in args.parts}
    tables = [f"## {part.capitalize()}\n\n{markdown(rows)}\n\n{note}" for part, (rows, note) in found.items()]
    how = "Each time is a median of several, each ratio is of one run. BLAS has one thread throughout."
    text = "\n\n".join([how, *tables])
    write_json(args.out / "bench.json", {part: rows for part, (rows, _) in found.items()})
    write_text(args.out / "bench.md", f"# Benchmark\n\n{provenance(command_line('benchmarks', args))}\n\n{text}\n")
    args.publish(text)


def markdown(rows: Rows) -> str:
    """A table; nothing for no rows."""
    return table(list(rows[0]), [[number(value) for value in row.values()] for row in rows]) if rows else ""


def number(value: Any) -> str:
    """Three digits of a float, everything of anything else."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


if __name__ == "__main__":
    run(Args, main)
