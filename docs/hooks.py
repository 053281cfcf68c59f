"""What MkDocs does beside its plugins: pages from the repository's root, their links, tables of code, and formulas.

Markdown files are written for the repository, where a link is relative to the file and may lead to any other file. On
the site a link to a page stays a link, and of one to another file the text is left.
"""

import logging
import os
import re
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
FROM_THE_ROOT = {"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md", "results.md": "RESULTS.md"}
"""Pages that stand in the repository's root, by their name on the site."""
README_PAGE = "index.md"
"""Where a link to the README leads."""

_TABLE = re.compile(r"<!-- table: (\w+) -->")
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
_log = logging.getLogger("mkdocs.hooks")


def on_startup(**_: Any) -> None:
    """Read the code beside this file, whatever else is installed."""
    sys.path.insert(0, str(ROOT))


def on_config(config: Any) -> Any:
    """Leave entries of the menu out whose page is not written."""
    entries = [(title, page) for entry in config.nav for title, page in entry.items()]
    for title, page in entries:
        if not source_of(page).is_file():
            _log.info("There is no %s: '%s' is left out", source_of(page).relative_to(ROOT), title)
    config.nav = [{title: page} for title, page in entries if source_of(page).is_file()]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of the repository's root."""
    for page in FROM_THE_ROOT:
        if source_of(page).is_file():
            files.append(File.generated(config, page, content=source_of(page).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Make the links those of the site, and the tables that come from the code."""
    from docs.tables import TABLES

    links = site_links(markdown, source_of(page.file.src_uri).parent)
    return _TABLE.sub(lambda table: TABLES[table[1]](), links)


def on_page_content(html: str, **_: Any) -> str:
    """Write formulas as MathML, which a browser shows without a script."""
    return _FORMULA.sub(_mathml, html)


def source_of(page: str) -> Path:
    """The file of the repository that a page of the site is made of."""
    return ROOT / FROM_THE_ROOT[page] if page in FROM_THE_ROOT else DOCS / page


def site_links(markdown: str, folder: Path) -> str:
    """``markdown`` with the relative links of a file in ``folder`` as the site has them."""

    def on_the_site(link: re.Match[str]) -> str:
        target = link["target"]
        path = (folder / target).resolve()
        if "://" in target or not path.exists():
            return link[0]
        pages = {ROOT / source: page for page, source in FROM_THE_ROOT.items()} | {ROOT / "README.md": README_PAGE}
        if path in pages:
            target = pages[path]
        elif path.is_relative_to(DOCS):
            target = Path(os.path.relpath(path, DOCS)).as_posix()
        elif not link["image"]:
            return link["text"]
        return f"{link['image']}[{link['text']}]({target}{link['anchor'] or ''})"

    return _LINK.sub(on_the_site, markdown)


def _mathml(formula: re.Match[str]) -> str:
    tag, bracket, source = formula.groups()
    plain = source.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    return f"<{tag}>{convert(plain, display='block' if bracket == '[' else 'inline')}</{tag}>"
