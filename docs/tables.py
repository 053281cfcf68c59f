"""`python -m docs.tables`: rewrite the sections of the manual that are made from the code, and from RESULTS.md."""

import ast
import dataclasses
import inspect
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from activeslam_gym import ActiveSLAMEnv, config
from activeslam_gym.envs.reward import REWARDS
from agents.learn import weights
from agents.tools.sections import put_section

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent


def sections_of(page: Path) -> dict[str, str]:
    """Name → text of the generated sections of a page, those without a text left out."""
    marks = r"<!-- generated: ([\w-]+) -->(.*?)<!-- end: \1 -->"
    found = re.finditer(marks, page.read_text(encoding="utf-8"), re.DOTALL)
    return {one[1]: one[2] for one in found if one[2].strip()}


def specification() -> str:
    """The docstring of the environment, which is its specification, in lines as short as those of other pages."""
    text = (inspect.getdoc(ActiveSLAMEnv) or "").partition("\nRaises:")[0].strip()
    return "\n\n".join(one if one[0] in "|#" else _filled(one) for one in text.split("\n\n"))


def _filled(paragraph: str) -> str:
    """A paragraph, or a list whose items stay apart, in lines of up to 100 characters."""
    given = {"width": 100, "break_on_hyphens": False}
    items = [" ".join(one.split()) for one in re.split(r"\n(?=- )", paragraph)]
    return "\n".join(fill(one, subsequent_indent="  " * one.startswith("- "), **given) for one in items)


def scenarios() -> str:
    """The named scenarios, the task of a policy in each, and fields that differ from the first."""
    first, *others = config.SCENARIOS.values()
    rows = [(f"`{first.name}`", config.ASKED[first.name], "")]
    for scenario in others:
        fields = [field.name for field in dataclasses.fields(scenario) if field.name != "name"]
        changed = [name for name in fields if getattr(scenario, name) != getattr(first, name)]
        shown = [f"`{name}` {_shown(getattr(scenario, name))}" for name in changed]
        rows.append((f"`{scenario.name}`", config.ASKED[scenario.name], "; ".join(shown)))
    return _table(("Scenario", "Task of a policy", f"Where it differs from `{first.name}`"), rows)


def fields() -> str:
    """Every field of a scenario with its default, its bounds, and the docstring under it; a table for each subject."""
    docs = _field_docstrings(config.Scenario)
    allowed = {name: ", ".join(bound.allowed for bound in bounds) for name, bounds in config.BOUNDS.items()}
    subjects = [base for base in config.Scenario.__mro__[1:] if vars(base).get("__annotations__")]
    parts = []
    for subject in reversed(subjects):
        own = [field for field in dataclasses.fields(config.Scenario) if field.name in vars(subject)["__annotations__"]]
        rows = [(f"`{f.name}`", _shown(f.default), allowed[f.name], docs[f.name]) for f in own]
        title = (inspect.getdoc(subject) or "").partition("\n")[0].rstrip(".")
        parts += [f"### {title}", _table(("Field", "Default", "Allowed", "What it is"), rows)]
    return "\n\n".join(parts)


def rewards() -> str:
    """The potentials and their docstrings."""
    docs = [inspect.getdoc(potential) or "" for potential in REWARDS.values()]
    rows = [(f"`{name}`", doc.replace("|", "\\|")) for name, doc in zip(REWARDS, docs, strict=True)]
    return _table(("Reward", "Its potential"), rows)


def clips() -> str:
    """The policies of the headline of RESULTS.md, with scores and clips."""
    table = sections_of(ROOT / "RESULTS.md")["headline"]
    found = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines() if "|" in line]
    scored = {row[0]: row for row in found[2:]}
    titles = ("log score gain, bits (median)", "under 0, %", "lost, %")
    if missing := [title for title in titles if title not in found[0]]:
        raise ValueError(f"the headline of RESULTS.md has no column {', '.join(missing)}")
    columns = [found[0].index(title) for title in titles]
    pictures = {path.stem for path in (DOCS / "images" / "clips").glob("*.gif")}
    rows = []
    for name, row in scored.items():
        kind = f"learned: [its card](../agents/pretrained/{name}.json)" if name in weights.shipped() else "computed"
        shown = f'<img src="images/clips/{name}.gif" width="320" alt="{name} in the episode 1000111">'
        clip = shown if name in pictures else ""
        rows.append((f"`{name}`<br>{kind}", *(row[column] for column in columns), clip))
    head = ("policy", "log score gain, bits: median", "under 0, %", "lost, %", "one episode, 4 times as fast")
    return _table(head, rows)


TABLES = {
    "specification": specification,
    "scenarios": scenarios,
    "fields": fields,
    "rewards": rewards,
    "clips": clips,
}
"""Name of a generated section, and the function that makes its text."""


def _field_docstrings(cls: type) -> dict[str, str]:
    """The string under each annotated field of a class and of its bases, in one line."""
    bodies = [ast.parse(inspect.getsource(base)).body[0].body for base in cls.__mro__[:-1]]  # type: ignore[attr-defined]
    return {
        field.target.id: " ".join(inspect.cleandoc(under.value.value).split())
        for body in bodies
        for field, under in zip(body, body[1:])
        if isinstance(field, ast.AnnAssign) and isinstance(under, ast.Expr)
    }


def _shown(value: Any) -> str:
    """A value as a reader types it; floats to four digits, as 45 degrees are 0.7854 rad."""
    if isinstance(value, tuple):
        return ", ".join(_shown(part) for part in value)
    return f"{value:.4g}" if isinstance(value, float) else f"`{value!r}`" if isinstance(value, str) else str(value)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    """Rewrite the sections in the pages that have them."""
    for name, text in ((name, make()) for name, make in TABLES.items()):
        pages = [page.name for page in sorted(DOCS.glob("*.md")) if put_section(page, name, f"\n{text}\n")]
        print(f"{name}: {', '.join(pages)}")


if __name__ == "__main__":
    main()
