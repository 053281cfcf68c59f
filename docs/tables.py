"""Tables of the manual that are made from the code: `<!-- table: scenarios -->` in a page becomes one of these."""

import ast
import dataclasses
import inspect
from collections.abc import Iterable, Sequence
from typing import Any

from activeslam_gym import config
from activeslam_gym.envs.reward import REWARDS


def scenarios() -> str:
    """The named scenarios, what they ask of a policy, and what is not as in the first of them."""
    first, *others = config.SCENARIOS.values()
    rows = [(f"`{first.name}`", config.ASKED[first.name], "")]
    for scenario in others:
        fields = [field.name for field in dataclasses.fields(scenario) if field.name != "name"]
        changed = [name for name in fields if getattr(scenario, name) != getattr(first, name)]
        told = [f"`{name}` {_shown(getattr(scenario, name))}" for name in changed]
        rows.append((f"`{scenario.name}`", config.ASKED[scenario.name], "; ".join(told)))
    return _table(("Scenario", "What it asks of a policy", f"Where it differs from `{first.name}`"), rows)


def fields() -> str:
    """Every field of a scenario with its default, its bounds, and the docstring under it."""
    told = _field_docstrings(config.Scenario)
    allowed = {name: ", ".join(bound.allowed for bound in bounds) for name, bounds in config.BOUNDS.items()}
    rows = [
        (f"`{f.name}`", _shown(f.default), allowed[f.name], told[f.name]) for f in dataclasses.fields(config.Scenario)
    ]
    return _table(("Field", "Default", "Allowed", "What it is"), rows)


def rewards() -> str:
    """The potentials and their docstrings."""
    told = [inspect.getdoc(potential) or "" for potential in REWARDS.values()]
    rows = [(f"`{name}`", doc.replace("|", "\\|")) for name, doc in zip(REWARDS, told, strict=True)]
    return _table(("Reward", "Its potential"), rows)


TABLES = {"scenarios": scenarios, "fields": fields, "rewards": rewards}


def _field_docstrings(cls: type) -> dict[str, str]:
    """The string that stands under each annotated field of a class, in one line."""
    body = ast.parse(inspect.getsource(cls)).body[0].body  # type: ignore[attr-defined]
    return {
        field.target.id: " ".join(inspect.cleandoc(under.value.value).split())
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
