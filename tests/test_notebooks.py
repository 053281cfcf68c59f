"""Notebooks import and never define, and are committed without their output; `pytest --nbmake notebooks` runs them."""

import ast
import json
import re
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))


def sources(path: Path, kind: str) -> list[str]:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == kind]


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_imports_and_never_defines(path: Path) -> None:
    for source in sources(path, "code"):
        tree = ast.parse(re.sub(r"^[%!].*$", "", source, flags=re.MULTILINE))
        defined = [n.name for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.ClassDef))]
        assert not defined, f"{', '.join(defined)} belongs into a module"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_teaches_and_is_small(path: Path) -> None:
    assert sources(path, "markdown")[0].startswith("# ")
    assert path.stat().st_size < 100_000, "clear its output"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_links_of_a_notebook_lead_to_files(path: Path) -> None:
    links = [link for text in sources(path, "markdown") for link in re.findall(r"\]\(([^)\s#]+)", text)]
    assert not [link for link in links if not re.match(r"[a-z]+:", link) and not (path.parent / link).exists()]
