"""Tables of the manual that are made from the code: `<!-- table: scenarios -->` in a page becomes one of these."""

import ast
import dataclasses
import inspect
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from activeslam_gym import config
from activeslam_gym.envs.reward import REWARDS


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


def leaderboard() -> str:
    """The policies of the headline of RESULTS.md, with scores and clips."""
    from agents import pretrained
    from agents.tools.sections import sections_of

    root = Path(__file__).resolve().parents[1]
    table = sections_of(root / "RESULTS.md")["headline"]
    found = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines() if "|" in line]
    scored = {row[0]: row for row in found[2:]}
    titles = ("log score gain, bits (median)", "under 0, %", "lost, %")
    if missing := [title for title in titles if title not in found[0]]:
        raise ValueError(f"the headline of RESULTS.md has no column {', '.join(missing)}")
    columns = [found[0].index(title) for title in titles]
    clips = {path.stem for path in (root / "docs" / "images" / "clips").glob("*.gif")}
    rows = []
    for name, row in scored.items():
        kind = f"learned: [its card](cards/{name}.md)" if name in pretrained.names() else "computed"
        clip = f"![{name} in the episode 1000111](images/clips/{name}.gif){{ width=320 }}" if name in clips else ""
        rows.append((f"`{name}`<br>{kind}", *(row[column] for column in columns), clip))
    head = ("policy", "log score gain, bits: median", "under 0, %", "lost, %", "one episode, 4 times as fast")
    return _table(head, rows)


TABLES = {"scenarios": scenarios, "fields": fields, "rewards": rewards, "leaderboard": leaderboard}


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
