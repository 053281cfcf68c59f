"""`python -m benchmarks`: measure, print, and write `bench.md` and `bench.json`."""

import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Literal, get_args

from threadpoolctl import threadpool_limits

from agents.tools.files import writable_folder, write_json, write_text
from agents.tools.sections import page_with, put_section

from .against import PAIRS, compare
from .report import Section, bar_table, provenance, report

Part = Literal["single", "batch", "images", "scores", "peers", "start"]
"""Each is a module of this package with `run(quick) -> Section`."""


@dataclass(frozen=True)
class Args:
    """Measure speed beside peers, and hold the figures against the bars."""

    parts: tuple[Part, ...] = get_args(Part)
    """What to measure."""
    quick: bool = False
    """Small sizes and few repeats, to see that it runs; the figures mean little."""
    out: Path = Path("results/bench")
    """Folder of `bench.md` and `bench.json`."""
    report: tuple[Path, ...] = ()
    """Pages whose generated sections "bench" (all of it) and "speed" (the bars) are regenerated."""
    against: str | None = None
    """A commit to measure in turn with this checkout; then nothing else is measured (ten minutes)."""


def main(args: Args, command: str = "python -m benchmarks") -> int:
    """Measure the parts; exit status 0, whether the bars are met or not."""
    if args.against is not None:
        print(compare(args.against, 1 if args.quick else PAIRS))
        return 0
    writable_folder("out", args.out)
    for page in args.report:
        page_with(page, "bench", "speed")
    sections: list[Section] = []
    modules = {part: import_module(f"benchmarks.{part}") for part in args.parts}
    with threadpool_limits(1):  # it reaches only the BLAS libraries that are loaded by now, SciPy's own among them
        for part, module in modules.items():
            begin = time.perf_counter()
            sections.append(module.run(args.quick))
            print(f"{part}: {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    measured_on = provenance(command)
    text = f"{measured_on}\n{report(sections)}"
    bars = [{**asdict(bar), "met": bar.met} for section in sections for bar in section.bars]
    parts = [asdict(section) for section in sections]
    write_json(args.out / "bench.json", {"measured_on": measured_on, "bars": bars, "sections": parts})
    write_text(args.out / "bench.md", f"# Benchmark\n\n{text}")
    print(f"# Benchmark\n\n{text}")
    for page in args.report:
        put_section(page, "bench", text)
        put_section(page, "speed", f"{measured_on}\n\n{bar_table(sections)}")
    return 0


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
