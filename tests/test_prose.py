"""Prose: short pages and sentences, and the words of the field in manual, docstrings and messages."""

import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
GENERATED = re.compile(r"<!-- generated: (.*?) -->.*?<!-- end: \1 -->", re.DOTALL)
FIRST_READ = ("README.md", "docs/index.md", "docs/start.md", "docs/tutorial.md", "docs/concepts.md")
LONGEST_SENTENCE = 25
LONGEST_LINE = 100  # of Markdown, beside tables and code
MOST_NUMBERS = 2  # in a sentence of the pages that come first
LEAST_EASE = 50  # Flesch's reading ease of these pages
MOST_WORDS = {"README.md": 900, "CHANGELOG.md": 600, "RESULTS.md": 1500, "docs/notes.md": 2000}
MANUAL = 18_000
"""Words of all pages of docs/, as `prose` has them: tables and headings count; code, formulas on lines of their own,
comments, directives and what a command has written do not."""
IDIOMS = re.split(
    r";\s+",
    r"""looks? at nothing; (?<!colour-)\bblind(ly)?\b; \bunseen\b; (nobody|none) has seen; \b(dis)?honest(y|ly)?\b;
    \b(too )?sure of\b; bits removed; what (was|is) learned; \banew\b; given up; trained again; \bstrangers?\b;
    \bfelt\b; \bbirths?\b; \bborn\b; \bmatur\w+; \bforg[eo]t\w*; \breferees?\b; \bclairvoyant\b; sees everything;
    \bforfeit\b; given away; \b(un)?luck\w*; holds zero; \bof (before|then|now)\b;
    \bwho (looks|decides|circles|stays)\b; \bthings?\b; \bearlier version""",
)
"""Private words for which the field has its own."""
NAMES = set(
    """
    ANYTHING Eye FORFEIT Gallery Glance Keeper NOBODY Prospect THING UNTOLD Waving Witness appraise birth births
    feel_contact felt foresee foresight forfeit forfeits give_birth hang honesty keeper luck mature prospect reconcile
    referee rehearsal rehearse settle take_in thing things told
    """.split()
)
"""Names that no code has."""
REMOVALS = ROOT / "studies" / "removals.py"  # its strings are code


def written(page: Path) -> str:
    """The text of a page without code, formulas, comments, directives and what a command has written."""
    text = GENERATED.sub("", page.read_text(encoding="utf-8"))
    text = re.sub(r"^:::.*\n(?:    .*\n)*", "", text, flags=re.MULTILINE)
    return re.sub(r"^ *```.*?^ *```$|<!--.*?-->|^\$\$.*?^\$\$$", "", text, flags=re.DOTALL | re.MULTILINE)


def prose(page: Path) -> str:
    """What is written, a link as its text, and code in backticks as one word."""
    text = re.sub(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)", r"\1", written(page))
    return re.sub(r"`[^`]*`", "code", text)


def sentences(text: str) -> list[str]:
    """Sentences of paragraphs and list items; tables and headings are left out."""
    lines = ["" if re.match(r" *(\||#|:::|--8<--)", line) else line for line in text.splitlines()]
    blocks = re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.) ", "\n".join(lines))
    return [one for block in blocks for one in re.split(r"(?<=[.!?])[*)]*\s+", " ".join(block.split())) if one]


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def prose_of_code(path: Path) -> str:
    """Comments, docstrings and messages, which are strings of four words or more, without names in backticks."""
    found = []
    for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
        if token.type == tokenize.COMMENT or token.type == tokenize.STRING and len(token.string.split()) > 3:
            found.append(re.sub(r"(`+)[^`]*\1", "code", token.string))
    return "\n".join(found)


@pytest.mark.parametrize("page", FIRST_READ)
def test_sentences_that_a_newcomer_reads_are_short(page: str) -> None:
    long = [one for one in sentences(prose(ROOT / page)) if len(one.split()) > LONGEST_SENTENCE]
    assert not long, "\n".join(long)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pages_use_the_words_of_the_field(page: Path) -> None:
    text = prose(page)
    found = {match[0] for idiom in IDIOMS for match in re.finditer(idiom, text, re.IGNORECASE)}
    assert not found, f"{name(page)}: {', '.join(sorted(found))}"


@pytest.mark.parametrize(
    "folder", ["activeslam_gym", "agents", "baselines", "benchmarks", "studies", "examples", "tests"]
)
def test_code_uses_the_words_of_the_field(folder: str) -> None:
    for path in sorted((ROOT / folder).rglob("*.py")):
        text = "" if path in (Path(__file__).resolve(), REMOVALS) else prose_of_code(path)
        found = {match[0] for idiom in IDIOMS for match in re.finditer(idiom, text, re.IGNORECASE)}
        assert not found, f"{name(path)}: {', '.join(sorted(found))}"


def test_pages_are_short() -> None:
    words = {name(page): len(prose(page).split()) for page in PAGES}
    assert not {page: words[page] for page, most in MOST_WORDS.items() if words[page] > most}
    assert sum(count for page, count in words.items() if page.startswith("docs/")) <= MANUAL


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_lines_are_short(page: Path) -> None:
    lines = [line for line in written(page).splitlines() if not line.lstrip().startswith("|")]  # beside tables
    assert not [line for line in lines if len(line) > LONGEST_LINE]


@pytest.mark.parametrize("page", ("README.md", "docs/tutorial.md", "docs/concepts.md"))
def test_the_first_pages_read_easily(page: str) -> None:
    """Few numbers in a sentence, and Flesch's formula with the syllables of `pyphen`."""
    import pyphen

    found = sentences(prose(ROOT / page))
    numbers = re.compile(r"(?<![\w-])\d+(?:[ .,]\d+)*")
    assert not [one for one in found if len(numbers.findall(one)) > MOST_NUMBERS]
    words = re.findall(r"[A-Za-z][A-Za-z'’-]*", " ".join(found))
    hyphens = pyphen.Pyphen(lang="en_GB")
    syllables = sum(len(hyphens.positions(word)) + 1 for word in words)
    ease = 206.835 - 1.015 * len(words) / len(found) - 84.6 * syllables / len(words)
    assert ease >= LEAST_EASE, ease


@pytest.mark.parametrize("folder", ["activeslam_gym", "agents", "baselines", "benchmarks", "studies", "examples"])
def test_names_are_words_of_the_field(folder: str) -> None:
    for path in sorted((ROOT / folder).rglob("*.py")):
        tokens = tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
        found = {token.string.strip("\"'") for token in tokens if token.type in (tokenize.NAME, tokenize.STRING)}
        assert not found & NAMES, f"{name(path)}: {', '.join(sorted(found & NAMES))}"
