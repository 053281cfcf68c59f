"""`python -m agents check-results`: are the pages of this `BEHAVIOUR`, this manifest, and one code?"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from activeslam_gym import BEHAVIOUR
from activeslam_gym.evaluation.code import digest
from agents.suite import entry as entries
from agents.suite.manifest import manifest_of
from agents.tools.machine import code_of
from agents.tools.sections import sections_of

PAGES = (
    "README.md",
    "RESULTS.md",
    "docs/BENCHMARKS.md",
    "docs/leaderboard.md",
    "docs/paper.md",
    "docs/live.md",
    "docs/consistency.md",
    "docs/clients.md",
    "docs/estimators.md",
)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Find generated sections whose numbers are of another `BEHAVIOUR`, manifest or code; the exit status is then 1."""

    pages: tuple[Path, ...] = tuple(map(Path, PAGES))
    """The pages."""


def main(args: Args) -> int:
    """Print what is stale; the exit status. Raises ValueError where a page or a suite is missing."""
    found = [f"{page}: {line}" for page in args.pages for line in stale(page)]
    where = codes(args.pages)
    if len(where) > 1:
        found += ["The numbers are of several codes:", *(f"- {code}: {', '.join(of)}" for code, of in where.items())]
    print("\n".join(found) or f"All generated sections are of BEHAVIOUR {BEHAVIOUR} and of one code.")
    return int(bool(found))


def codes(pages: Sequence[Path]) -> dict[str, list[str]]:
    """By code (see `machine.code`): the generated sections of the pages, and the shipped entries."""
    found: dict[str, list[str]] = {}
    for page in pages:
        for name, text in sections_of(page).items():
            for code in set(re.findall(r"\bcode ([0-9a-f]{12})\b", text)) or {"unknown"}:
                found.setdefault(code, []).append(f"{page} ({name})")
    for entry in map(entries.read, sorted(entries.FOLDER.glob(f"*/{entries.FILE}"))):
        found.setdefault(code_of(entry.sources), []).append(f"the entry {entry.name}")
    return found


def stale(page: Path) -> list[str]:
    """What a page's generated sections are of, where that is not this code."""
    lines = []
    for name, text in sections_of(page).items():
        behaviours = {int(one) for one in re.findall(r"\bBEHAVIOUR (\d+)", text)}
        if behaviours - {BEHAVIOUR}:
            lines.append(
                f"the section {name!r} is of BEHAVIOUR {min(behaviours - {BEHAVIOUR})}, this code of {BEHAVIOUR}"
            )
        elif not behaviours:
            lines.append(f"the section {name!r} does not say its BEHAVIOUR")
        for of, manifest in re.findall(r"suite (\S+), manifest (\w+)", text):
            path = manifest_of(of)
            if not path.is_file() or digest(path) != manifest:
                lines.append(f"the section {name!r} is of another manifest of the suite {of!r}")
    return lines
