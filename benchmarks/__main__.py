"""`python -m benchmarks`: measure, print, and write `bench.md` and `bench.json`."""

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from threadpoolctl import threadpool_limits

from agents.tools.files import writable_folder, write_json, write_text
from agents.tools.sections import page_with, provenance, put_section, table

from . import environments, peers
from .against import PAIRS, compare, start

Rows = list[dict[str, Any]]  # they share their keys, which are the table's head, with units
PARTS: dict[str, Callable[[bool], tuple[Rows, str]]] = {
    "single": environments.single,
    "batch": environments.batches,
    "images": environments.images,
    "scores": environments.scores,
    "peers": peers.run,
    "start": start,
}
"""Each measures, in small sizes and with few repeats where it is asked to be quick, and says how."""


@dataclass(frozen=True)
class Args:
    """Measure speed beside peers."""

    parts: tuple[Literal["single", "batch", "images", "scores", "peers", "start"], ...] = tuple(PARTS)  # type: ignore
    """Parts to measure."""
    quick: bool = False
    """Use small sizes and few repeats, to see that it runs."""
    out: Path = Path("results/bench")
    """Folder in which bench.md and bench.json are written."""
    report: Path | None = None
    """Page in which the generated section bench is rewritten."""
    against: str | None = None
    """Commit to measure in turn with this checkout, and nothing else (ten minutes)."""


def main(args: Args, command: str = "python -m benchmarks") -> int:
    """Measure the parts; the exit status."""
    if args.against is not None:
        print(compare(args.against, 1 if args.quick else PAIRS))
        return 0
    writable_folder("out", args.out)
    if args.report:
        page_with(args.report, "bench")
    with threadpool_limits(1):  # it reaches only the BLAS libraries that are loaded by now, SciPy's own among them
        found = {part: PARTS[part](args.quick) for part in args.parts}
    tables = [f"## {part.capitalize()}\n\n{markdown(rows)}\n\n{note}" for part, (rows, note) in found.items()]
    how = "Each time is a median of several, each ratio is of one run. BLAS has one thread throughout."
    text = "\n\n".join([provenance(command), how, *tables])
    write_json(args.out / "bench.json", {part: rows for part, (rows, _) in found.items()})
    write_text(args.out / "bench.md", f"# Benchmark\n\n{text}\n")
    print(text)
    if args.report:
        put_section(args.report, "bench", text)
    return 0


def markdown(rows: Rows) -> str:
    """A table; nothing for no rows."""
    return table(list(rows[0]), [[number(value) for value in row.values()] for row in rows]) if rows else ""


def number(value: Any) -> str:
    """Three digits of a float, everything of anything else."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def entry(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and measure."""
    import tyro

    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        args = tyro.cli(Args, prog="python -m benchmarks", args=arguments)
        return main(args, shlex.join(["python", "-m", "benchmarks", *arguments]))
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError) as error:
        print(f"python -m benchmarks: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(entry())
