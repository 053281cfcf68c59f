"""What MkDocs does beside its plugins: pages of files outside docs/, their links, tables of code, and formulas.

Markdown files are written for the repository, where a link is relative to the file and may lead to any other file. On
the site a link to a page stays a link, notebooks, examples and cards are pages too, and of a link to another file the
text is left.
"""

import json
import logging
import os
import re
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
FROM_THE_ROOT = ("CHANGELOG.md", "CONTRIBUTING.md", "RESULTS.md")
"""Pages that stand in the repository's root; on the site their names are in lower case."""
SHOWN = {
    "notebooks": (ROOT / "notebooks", "*.ipynb"),
    "examples": (ROOT / "examples", "**/*.*"),
    "cards": (ROOT / "agents" / "pretrained", "*.json"),
}
"""Folder on the site, and the files that are shown there, each as a page."""
KINDS = {".py": "python", ".yml": "yaml", ".json": "json"}
WIDE = {"results.md", "paper.md", "BENCHMARKS.md", "leaderboard.md"}
"""Pages of wide tables: they have no table of contents beside them."""
FONT = "assets/STIXTwoMath-Regular.ttf"
"""A font for formulas, for readers whose system has none; it comes with the package ziamath (SIL Open Font License)."""

_INCLUDED = re.compile(r'^--8<-- "([\w/]+\.md):(\w+)"$', re.MULTILINE)
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
_BARS, _RIGID = "<mo>&#x02016;</mo>", '<mo stretchy="false">'
"""The bars of a norm, which else grow with the letter between them."""
_log = logging.getLogger("mkdocs.hooks")


def on_startup(**_: Any) -> None:
    """Read the code beside this file, whatever else is installed."""
    sys.path.insert(0, str(ROOT))


def on_config(config: Any) -> Any:
    """Fill the menu's groups of shown files, and leave entries out whose page is not written."""
    config.nav = [{title: _written(entry)} for group in config.nav for title, entry in group.items()]
    return config


def _written(entry: Any) -> Any:
    """A page, or the pages of a group that there are; the name of a folder of `SHOWN` stands for its pages."""
    if isinstance(entry, str):
        shown = [(source, page) for source, page in shown_files().items() if page.startswith(f"{entry}/")]
        return [{title_of(source, page): page} for source, page in shown] if entry in SHOWN else entry
    return [
        {title: _written(page)}
        for one in entry
        for title, page in one.items()
        if not isinstance(page, str) or page in SHOWN or source_of(page).is_file()
    ]


def shown_files() -> dict[Path, str]:
    """Files outside docs/ that the site shows as pages, and the page of each."""
    found = {ROOT / name: name.lower() for name in FROM_THE_ROOT if (ROOT / name).is_file()}
    for folder, (home, pattern) in SHOWN.items():
        for source in sorted(home.glob(pattern)):
            if source.suffix in (*KINDS, ".ipynb"):
                name = source.relative_to(home).with_suffix("").as_posix().replace("/", "-")
                found[source] = f"{folder}/{name}.md"
    return found


def source_of(page: str) -> Path:
    """The file of the repository that a page of the site is made of."""
    return next((source for source, shown_as in shown_files().items() if shown_as == page), DOCS / page)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of files outside docs/, and the font of formulas."""
    for source, page in shown_files().items():
        files.append(File.generated(config, page, content=page_of(source)))
    if spec := find_spec("ziamath"):
        font = Path(str(spec.origin)).parent / "fonts" / Path(FONT).name
        files.append(File.generated(config, FONT, content=font.read_bytes()))
    else:
        _log.info("ziamath is not installed: formulas have the reader's own fonts")
    return files


def title_of(source: Path, page: str) -> str:
    """What the menu calls a file that is shown: a notebook by its title."""
    if source.suffix != ".ipynb":
        return Path(page).stem + source.suffix
    return next(_cells(json.loads(source.read_text(encoding="utf-8")))).partition("\n")[0].removeprefix("# ")


def page_of(source: Path) -> str:
    """A page, a notebook, an example or a card as Markdown."""
    text, name = source.read_text(encoding="utf-8"), source.relative_to(ROOT).as_posix()
    if source.suffix == ".md":
        return text
    if source.suffix == ".ipynb":
        note = f"*This is `{name}`; to run it, see [how to open the notebooks](../start.md#the-notebooks).*"
        return "\n\n".join([*_cells(json.loads(text)), note])
    return f"# {name}\n\n```{KINDS[source.suffix]}\n{text}```\n"


def _cells(notebook: dict[str, Any]) -> Iterator[str]:
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        yield text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Make the links those of the site, and include sections of other pages."""
    if page.file.src_uri in WIDE:
        page.meta["hide"] = ["toc"]
    at = os.path.dirname(page.file.src_uri) or "."
    text = site_links(markdown, source_of(page.file.src_uri).parent, at)
    return _INCLUDED.sub(lambda line: site_links(*_section(ROOT / line[1], line[2]), at), text)


def _section(page: Path, name: str) -> tuple[str, Path]:
    """The text between the marks of a section of a Markdown file, and the folder of its links."""
    text = page.read_text(encoding="utf-8").partition(f"[start:{name}] -->\n")[2]
    return text.partition(f"<!-- --8<-- [end:{name}]")[0], page.parent


def on_page_content(html: str, **_: Any) -> str:
    """Write formulas as MathML, which a browser shows without a script."""
    return _FORMULA.sub(_mathml, html)


def site_links(markdown: str, folder: Path, at: str = ".") -> str:
    """``markdown`` of a file in ``folder`` with its relative links as a page in the site's folder ``at`` has them."""

    pages = shown_files() | {ROOT / "README.md": "index.md"}

    def on_the_site(link: re.Match[str]) -> str:
        target = link["target"]
        path = (folder / target).resolve()
        if "://" in target or not path.exists():
            return link[0]
        if path in pages or path.is_relative_to(DOCS):
            page = DOCS / pages[path] if path in pages else path
            target = os.path.relpath(page, DOCS / at).replace(os.sep, "/")
        elif not link["image"]:
            return link["text"]
        return f"{link['image']}[{link['text']}]({target}{link['anchor'] or ''})"

    return _LINK.sub(on_the_site, markdown)


def _mathml(formula: re.Match[str]) -> str:
    tag, bracket, source = formula.groups()
    plain = source.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    written = convert(plain, display="block" if bracket == "[" else "inline")
    return f"<{tag}>{written.replace(_BARS, _BARS.replace('<mo>', _RIGID))}</{tag}>"
