"""The manual tells the truth: its tables are the code's, its code runs, its names exist, and it builds."""

import ast
import importlib
import importlib.util
import inspect
import json
import re
import shlex
from pathlib import Path

import gymnasium as gym
import pytest

import baselines
from activeslam_gym import ActiveSLAMEnv, Gaze, Motion, observation_layout
from activeslam_gym import __main__ as own_command_line
from activeslam_gym.config import SCENARIOS
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.information import CRITERIA
from agents.__main__ import COMMANDS
from agents.learn import weights
from docs.tables import TABLES, sections_of
from examples import fisher_trace
from tests.support import python

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path for pattern in ("*.md", "docs/**/*.md", ".github/**/*.md") for path in ROOT.glob(pattern) if path.is_file()
)
MATHEMATICS = (ROOT / "docs" / "mathematics.md").read_text(encoding="utf-8")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SPECIFICATION = inspect.getdoc(ActiveSLAMEnv) or ""


def rows(markdown: str) -> list[list[str]]:
    """The cells of every row of every table, heads and rules left out."""
    lines = [line.strip() for line in markdown.splitlines()]
    tables = [line for line in lines if line.startswith("|")]
    body = [line for i, line in enumerate(tables) if "---" not in line and "---" not in "".join(tables[i + 1 : i + 2])]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in body]


def section(title: str) -> str:
    """A section of the environment's specification."""
    found = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", SPECIFICATION, re.DOTALL | re.MULTILINE)
    assert found, f"the specification has no section {title}"
    return found[1]


def test_observation_table_is_the_layout() -> None:
    told = [(row[0].strip("`"), int(row[1])) for row in rows(section("Observation space"))]
    assert "32 + 11 (K + N + 13)" in section("Observation space")
    for name in SCENARIOS:
        env = gym.make("ActiveSLAM-v0", scenario=name)
        layout, inner = observation_layout(env), env.unwrapped.scenario
        slices = [*layout.global_slices.items(), *layout.token_slices.items()]
        sizes = [(name, at.stop - at.start) for name, at in slices]
        assert [one for one in told if inner.has_boxes or one != ("clearance", 7)] == sizes
        assert layout.size == 32 + 7 * inner.has_boxes + 11 * (inner.fiducial_count + inner.landmark_count + 13)


def test_the_specification_tells_actions_arguments_and_versions() -> None:
    told = rows(section("Action space"))
    assert [(int(row[0]), re.match(r"\w+", row[1])[0]) for row in told] == [(m.value, m.name) for m in Motion]
    gazes = [re.match(r"\w+", row[2])[0] for row in told if len(row) > 2 and row[2].strip("| ")]
    assert gazes == [gaze.name for gaze in Gaze]
    signature = inspect.signature(ActiveSLAMEnv.__init__).parameters
    told = [(row[0].strip("`"), row[1].strip("`")) for row in rows(section("Arguments"))]
    defaults = [
        (name, repr(p.default).replace("'", '"')) for name, p in signature.items() if name not in ("self", "unknown")
    ]
    assert told == defaults
    versions = {name.rsplit("-", 1)[1] for name in gym.registry if name.startswith("ActiveSLAM")}
    assert set(re.findall(r"^- (v\d+):", section("Version history"), re.MULTILINE)) == versions


def test_information_tables_are_what_is_returned() -> None:
    env = gym.make("ActiveSLAM-v0")
    infos = [env.reset(seed=0)[1], env.step((Motion.UP, Gaze.LEFT))[4]]
    for info in infos:
        told = [row[0].strip("`") for row in rows(section("Information"))]
        assert sorted(told) == sorted([*info, *info["events"]])
        assert list(info["reward_terms"]) == [*REWARDS, "lost_penalty"]


def test_the_gallery_has_the_scenarios_as_they_are() -> None:
    told = [(re.search(r"`([\w-]+)`", row[1])[1], *row[2:]) for row in rows((ROOT / "docs" / "worlds.md").read_text())]
    sizes = {name: one.room_size for name, one in SCENARIOS.items()}
    assert told == [
        (name, f"{one.duration:g}", f"{one.landmark_count}", f"{sizes[name][0]:g} × {sizes[name][2]:g}")
        for name, one in SCENARIOS.items()
    ]


def test_relative_links_lead_to_files() -> None:
    generated = {"changelog.md", "contributing.md", "results.md"}  # on the site they come from the root
    for page in [*PAGES, *NOTEBOOKS]:
        text = "\n".join(cells(page, "markdown")) if page in NOTEBOOKS else page.read_text(encoding="utf-8")
        text = re.sub(r"```.*?```|<!--.*?-->|`[^`\n]*`", "", text, flags=re.DOTALL)
        links = {link for link in re.findall(r"\]\(([^)\s#]+)", text) if not re.match(r"[a-z]+:", link)} - generated
        assert not [link for link in links if not (page.parent / link).exists()], page


def cells(notebook: Path, kind: str) -> list[str]:
    found = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def test_sections_that_are_made_from_the_code_are_as_it_makes_them() -> None:
    sections = {name: text for page in PAGES for name, text in sections_of(page).items()}
    for name, make in TABLES.items():
        assert sections[name].strip() == make().strip(), f"{name}: run python -m docs.tables"


def test_the_code_of_a_titled_block_is_in_the_file_of_that_name() -> None:
    found = 0
    for page in PAGES:
        blocks = re.findall(r'^```python title="(.*?)"\n(.*?)^```', page.read_text(encoding="utf-8"), re.DOTALL | re.M)
        for name, code in blocks:
            told, there = ([one.strip() for one in text.splitlines()] for text in (code, (ROOT / name).read_text()))
            assert any(there[i : i + len(told)] == told for i in range(len(there))), f"{page.name}: {name}: {told[0]}"
        found += len(blocks)
    assert found > 8


SNIPPETS = [
    pytest.param(page.name, code, id=f"{page.stem}-{i}")
    for page in PAGES
    if page.parent == ROOT / "docs" or page == ROOT / "README.md"
    for i, code in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.M))
    if "--8<--" not in code
]


@pytest.mark.parametrize(("page", "code"), SNIPPETS)
def test_snippet_runs(page: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "agents.load" in code or "stable_baselines3" in code:
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    code = code.replace("learn(16_000)", "learn(1_120)").replace("envs, 32)", "envs, 2)")  # else a minute or two
    exec(compile(code, f"<{page}>", "exec", dont_inherit=True), {"__name__": "manual"})


def test_the_options_of_every_command_line_of_the_manual_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    tyro = pytest.importorskip("tyro")
    monkeypatch.chdir(ROOT)
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES).replace("\\\n", " ")
    lines = [
        line for block in re.findall(r"^```bash\n(.*?)^```", text, re.DOTALL | re.M) for line in block.splitlines()
    ]
    told = [
        shlex.split(line, comments=True) for line in lines if re.match(r"(\.venvs/\w+/bin/)?python -m|make \w", line)
    ]
    commands = {name: importlib.import_module(module).Args for name, module in COMMANDS.items()}
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    for program, *words in told:
        module, *arguments = words[1:] if program != "make" else words
        if program == "make":
            assert module in targets or module.startswith("client-"), module
        elif module == "agents" and "--help" not in arguments:
            tyro.extras.subcommand_cli_from_dict(commands, args=arguments)
        elif module == "activeslam_gym":
            own_command_line.parser().parse_args(arguments)
        elif module.startswith("studies.") and hasattr(study := importlib.import_module(module), "Args"):
            tyro.cli(study.Args, args=arguments)
        elif not module.startswith("rl_zoo3"):
            assert importlib.util.find_spec(module), module
    assert len(told) > 40


def test_the_mathematics_names_code_that_exists_criteria_and_what_cites_it() -> None:
    told = rows(MATHEMATICS)
    named = {name for row in told for name in re.findall(r"`((?:\w+\.)+\w+)`", row[-1])}
    named |= set(re.findall(r"`((?:slam|information|motion|camera|metrics|envs)\.[\w.]+)`", MATHEMATICS))
    assert len(named) > 30
    for name in named:
        module, attribute = name.rsplit(".", 1)
        assert hasattr(importlib.import_module(f"activeslam_gym.{module}"), attribute), name
    assert {row[0].strip("`") for row in told} >= set(CRITERIA)
    package = ROOT / "activeslam_gym"
    for path in sorted(package.rglob("*.py")):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                if re.search(r"\b([Ee]quation|[Ss]ection|[Aa]ppendix)\b", ast.get_docstring(node) or ""):
                    assert f"`{module}.{node.name}`" in MATHEMATICS, f"{module}.{node.name}"


def test_the_table_of_policies_and_that_of_the_fisher_trace_are_the_codes() -> None:
    text = (ROOT / "docs" / "policies.md").read_text(encoding="utf-8")
    table = text[text.index("| Policy |") : text.index("## Open-loop policies")]
    told = [name for row in rows(table) for name in re.findall(r"`([\w-]+)`", row[0])]
    assert told == [*baselines.names(), *weights.shipped()]
    assert "README.md" in [snippet.values[0] for snippet in SNIPPETS]
    assert fisher_trace.TABLE in MATHEMATICS
    shown = [(float(row[1]), float(row[2].split()[0])) for row in rows(fisher_trace.TABLE)]
    assert shown == [(round(trace), float(f"{bits:.3g}")) for trace, bits in fisher_trace.main()]


def test_the_manual_builds_without_a_warning_and_opens_as_a_file(tmp_path: Path) -> None:
    """Every link leads to a file, nothing comes from elsewhere, and what is shown of the repository is there."""
    for needed in ("mkdocs", "mkdocstrings", "material", "latex2mathml"):
        pytest.importorskip(needed)
    site = tmp_path / "site"
    python("-m", "mkdocs", "build", "--strict", "--site-dir", site, cwd=ROOT)
    text = {page.relative_to(site).as_posix(): page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    assert all(f"<code>{name}</code>" in text["environment.html"] for name in [*REWARDS, *SCENARIOS])
    assert {f"notebooks/{path.stem}.html" for path in NOTEBOOKS} <= set(text)
    assert text["mathematics.html"].count("<math ") > 50 and "arithmatex" not in text["mathematics.html"]
    del text["404.html"]  # which a server shows at any address
    for page, html in text.items():
        assert not re.findall(r'<(?:script|img)\b[^>]*?\bsrc="?(https?://[^"\s>]+)', html), page
        targets = re.findall(r'<(?:a|link|img|script)\b[^>]*?\b(?:href|src)="?([^"\s>]+)', html)
        local = {target.partition("#")[0] for target in targets if not re.match(r"[a-z]+:|#|$", target)}
        assert not [target for target in local if not ((site / page).parent / target).is_file()], page
