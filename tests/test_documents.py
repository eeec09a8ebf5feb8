"""The documents: their Python runs, their commands exist, their links lead on."""

import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import grimp
import pytest

from humanplay.cli.main import cli
from humanplay.tasks.mars import cli as mars
from marsexplorer.policies.files.card import of_paper, read_card, shipped
from tests.support.browser import QUIET, chromium_path

ROOT = Path(__file__).parents[1]
_spec = importlib.util.spec_from_file_location("draw_tables", ROOT / "docs/draw_tables.py")
draw_tables = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(draw_tables)
HEADINGS = [
    "Description",
    "Action Space",
    "Observation Space",
    "Rewards",
    "Starting State",
    "Episode End",
    "Information",
    "Arguments",
    "Version History",
]


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(), re.M | re.S)


@pytest.mark.parametrize("path", ["docs/environment.md", "docs/policies.md"])
def test_every_block_of_python_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, code in enumerate(blocks(path)):
        exec(compile(code, f"{path}, block {number + 1}", "exec"), names)
    assert names


DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "AGENTS.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "data").rglob("README.md")),
    *sorted((ROOT / "research").rglob("README.md")),
    *sorted((ROOT / "examples").rglob("README.md")),
]
CARDS = {**shipped(), **of_paper()}
GROUPS = {"humanplay": cli, "marsexplorer": mars.cli}
PROGRAMS = (*GROUPS, "python", "pytest", "make")
TOP = "app|marsexplorer|static|data|tests|docs|examples|deploy|research"


def texts():
    """Every document and every policy's card: name, prose with commands in code."""
    for path in DOCUMENTS:
        yield str(path.relative_to(ROOT)), path.read_text()
    for name, path in CARDS.items():
        card = read_card(path)
        words = (str(card[key]) for key in ("summary", "limits", "prices") if key in card)
        yield (
            f"card of {name}",
            "\n".join([*words, f"`{card['command']}`" if "command" in card else ""]),
        )


def commands(text):
    """The commands of a text, in code blocks and between backticks, without comments."""
    text = text.replace("\\\n", " ")
    block = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
    shells = [code for language, code in block.findall(text) if language in ("", "sh", "console")]
    lines = [line for code in shells for line in code.splitlines()]
    prose = block.sub("", text)
    lines += [re.sub(r"\s+", " ", code) for code in re.findall(r"`([^`]+)`", prose)]
    for line in lines:
        for command in re.split(r"\s(?:&&|\||;|>)\s", re.sub(r"\s#.*", "", line)):
            command = re.sub(r"^(\S*/bin/|[A-Z_]+=\S* )*", "", command.strip())
            words = command.split()
            if len(words) > 1 and words[0] in PROGRAMS:
                yield command


def refusal(command):
    """Why a command could not run in this checkout; None if it could."""
    program, *words = shlex.split(command)
    if program in GROUPS:
        return refusal_of_click(GROUPS[program], words)
    if program == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M)
        return None if "=" in words[0] or words[0] in targets else f"no target {words[0]}"
    if words[0] == "-m" and words[1].startswith("research"):
        return refusal_of_module(*words[1:])
    files = [word.split("::")[0] for word in words if word.split("::")[0].endswith(".py")]
    absent = [file for file in files if not (ROOT / file).exists() and re.match(TOP, file)]
    if "-k" in words and not absent:
        parts = re.split(r" (?:or|and) ", words[words.index("-k") + 1])
        written = "".join((ROOT / file).read_text() for file in files)
        absent = [part for part in parts if not re.search(rf"def test_\w*{part}", written)]
        return f"no test {absent[0]}" if absent else None
    return f"no file {absent[0]}" if absent else None


def refusal_of_module(module, *words):
    """A module of research that is absent, or an option that it does not have."""
    path = ROOT / module.replace(".", "/")
    if not path.with_suffix(".py").is_file() and not (path / "__main__.py").is_file():
        return f"no module {module}"
    folder = path if path.is_dir() else path.parent
    shared = ROOT / "app/humanplay/tasks/mars/cli/options.py"
    written = "".join(file.read_text() for file in [shared, *folder.rglob("*.py")])
    absent = [word for word in words if word[:2] == "--" and f'"{word}"' not in written]
    return f"no option {absent[0]}" if absent else None


def refusal_of_click(command, words):
    """How a command refuses words.

    Placeholders (LEVEL, ...) and files that a user has are fine.
    """
    foreign = [word for word in words if re.fullmatch(r"runs/\S+\.[a-z]+", word)]
    foreign = [word for word in foreign if not word.endswith((".onnx", ".log", ".png"))]
    if foreign:
        return f"no run writes {foreign[0]}"
    while isinstance(command, click.Group) and words:
        name, *words = words
        if name.startswith("-") or re.fullmatch(r"\.\.\.|…|[A-Z]+", name):
            return None
        command = command.get_command(click.Context(command), name)
        if command is None:
            return f"no command {name}"
    if not words:  # a mention of the command
        return None
    try:
        command.make_context(name, list(words))
    except click.exceptions.Exit:  # --help
        return None
    except click.MissingParameter as error:
        return error.format_message() if isinstance(error.param, click.Option) else None
    except click.NoSuchOption as error:
        return error.format_message()
    except click.UsageError as error:
        has_placeholder = any(re.search(r"[A-Z]{2,}|\bN\b|\.\.\.|\[", word) for word in words)
        is_mention = "requires an argument" in error.format_message() and len(words) == 1
        is_file = "does not exist" in error.format_message()
        return None if has_placeholder or is_mention or is_file else error.format_message()


@pytest.mark.parametrize(("name", "text"), list(texts()))
def test_no_document_and_no_card_names_a_command_that_is_refused(name, text):
    refused = {command: refusal(command) for command in commands(text)}
    assert {command: error for command, error in refused.items() if error} == {}


def test_commands_are_read_from_documents_and_wrong_ones_are_noticed():
    shown = [command for _, text in texts() for command in commands(text)]
    assert len(shown) > 250
    wrong = [
        "marsexplorer train --recipe paper",
        "marsexplorer fly --high",
        "marsexplorer evaluate --episodes 5",
        "python -m research.paper --colour blue",
        "python -m research.gone",
        "python examples/gone.py",
        "pytest tests/test_documents.py -k neither_this",
        "make tea",
        "marsexplorer evaluate --policy runs/a/a.safetensors",
    ]
    text = (
        "```sh\n" + "\n".join(wrong[:4]) + "\n```\n" + " ".join(f"`{line}`" for line in wrong[4:])
    )
    assert list(commands(text)) == wrong
    assert [line for line in wrong if refusal(line) is None] == []


def is_made(path):
    """Whether a path is a file that the software writes, or one of the paper's code."""
    if path.startswith("tests/rollout/"):
        return True
    ignored = subprocess.run(
        ["git", "check-ignore", path, f"{path}/"], cwd=ROOT, capture_output=True, check=False
    )
    return bool(ignored.stdout)


@pytest.mark.parametrize(("name", "text"), list(texts()))
def test_every_file_that_a_document_or_a_card_names_exists(name, text):
    paths = set(re.findall(rf"`((?:{TOP})/[\w./-]*\w)`", text))
    links = {link for link in re.findall(r"\]\(([^)# ]+)", text) if ":" not in link}
    folder = (ROOT / name).parent
    paths = {path for path in paths if not re.search(r"/[A-Z]+/", path)}  # placeholders
    absent = [path for path in paths if not (ROOT / path).exists() and not is_made(path)]
    absent += [link for link in links if not (folder / link).exists()]
    assert sorted(absent) == []


def test_the_environments_page_has_gymnasiums_headings_in_their_order():
    headings = re.findall(r"^## (.*)$", (ROOT / "docs/environment.md").read_text(), re.M)
    assert [heading for heading in headings if heading in HEADINGS] == HEADINGS


def test_the_page_tells_the_spaces_the_environment_has():
    import gymnasium

    import marsexplorer  # noqa: F401

    env = gymnasium.make("MarsExplorer-v0")
    text = (ROOT / "docs/environment.md").read_text()
    assert f"| Observation Space | `{env.observation_space}` |" in text
    assert f"| Action Space | `{env.action_space}` |" in text


@pytest.mark.long
def test_the_notebook_runs_from_top_to_bottom(tmp_path):
    cells = json.loads((ROOT / "examples/tutorial.ipynb").read_text())["cells"]
    script = tmp_path / "tutorial.py"
    script.write_text(
        "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    )
    env = {
        "MPLBACKEND": "agg",
        "PYTHONPATH": f"{ROOT}:{ROOT / 'app'}",
        "PATH": "",
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, script],
        env=env,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    mine, chance = (
        float(re.search(rf"^{name} +([\d.]+) moves of", done.stdout, re.M)[1])
        for name in ("mine", "random")
    )
    assert mine < chance


@pytest.mark.long
def test_the_site_builds_without_a_warning_and_asks_nobody_else(tmp_path):
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--site-dir",
        str(tmp_path / "site"),
    ]
    env = os.environ | {"NO_MKDOCS_2_WARNING": "1"}  # an advertisement of the theme's
    done = subprocess.run(
        command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    pages = {path.name: path.read_text() for path in (tmp_path / "site").glob("*.html")}
    cards = re.search(r'<div class="readers">(.*?)</div>', pages["index.html"], re.DOTALL)[1]
    for card in re.findall(r"<li>(.*?)</li>", cards, re.DOTALL):
        words = re.split(r"<a .*?</a>", card, flags=re.DOTALL)[1:]
        assert {word.strip() for word in words[:-1]} <= {"<br>"}
        assert card.count("<br>") == len(words), (
            "each link has a line of its own, after the sentence"
        )
    assert {
        "index.html",
        "playing.html",
        "tutorial.html",
        "reference.html",
        "examples.html",
        "changelog.html",
    } <= set(pages)
    assert "marsexplorer.episode.Episode" in pages["reference.html"]
    frames = re.findall(r'<iframe src="([^"]+)"', pages["gallery.html"])
    assert len(frames) == 4
    assert all("replay-data" in (tmp_path / "site" / frame).read_text() for frame in frames)
    links = [
        words for text in pages.values() for words in re.findall(r"<a [^>]*>([^<]*)</a>", text)
    ]
    assert [words for words in links if words.endswith(".md")] == []
    assert 'href="architecture.html"' in pages["contributing.html"]
    folds = re.findall(r'<details class="fold"( open)?><summary><h2', pages["study.html"])
    assert folds == [" open", *[""] * (pages["study.html"].count("<h2") - 1)]
    assert "--board-ground: #" in (tmp_path / "site/colours.css").read_text()
    for name, text in pages.items():
        assert not re.findall(
            r'<(?:script|link rel="stylesheet")[^>]*(?:src|href)="https?:', text
        ), name
    if chromium_path() is None:
        pytest.skip("NO CHROMIUM: install it to look at the pages")
    assert too_long_or_cut(tmp_path / "site") == []


LONG_PX = 8_000
CUT = "[...document.querySelectorAll('pre > code')].some(code => code.scrollWidth > code.clientWidth + 1)"


def too_long_or_cut(site: Path) -> list[str]:
    """The pages that are too long on a desk, and those with cut code.

    The paper's may be long.
    """
    from playwright.sync_api import sync_playwright

    wrong = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=QUIET)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        for path in sorted(site.glob("*.html")):
            page.goto(path.as_uri())
            height = page.evaluate("document.documentElement.scrollHeight")
            if page.evaluate(CUT) or (height > LONG_PX and not path.name.startswith("paper")):
                wrong.append(f"{path.name}: {height}")
        browser.close()
    return wrong


@pytest.mark.parametrize("page", draw_tables.PAGES)
def test_the_tables_are_what_the_code_says(page):
    text = (ROOT / "docs" / page).read_text()
    assert draw_tables.redraw(text) == text, "`make tables` draws them again"


def test_the_pages_types_are_what_the_api_answers():
    for name, text in draw_tables.api_types().items():
        assert (ROOT / "static" / name).read_text() == text, "`make tables` draws it again"


def test_every_document_is_in_the_sites_navigation():
    listed = set(re.findall(r"- ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    assert {path.name for path in (ROOT / "docs").glob("*.md")} <= listed


@pytest.mark.parametrize("page", ["security.md", "reliability.md"])
def test_every_test_that_a_page_names_exists(page):
    """A path of a test is a file; a name, or its beginning, is a test somewhere."""
    words = set(
        re.findall(r"(?:tests/[\w/]+\.py|\btest_\w+\b(?!\.py))", (ROOT / "docs" / page).read_text())
    )
    files = {word for word in words if word.endswith(".py")}
    assert files
    assert [path for path in sorted(files) if not (ROOT / path).is_file()] == []
    written = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name in sorted(words - files) if not re.search(rf"def {name}", written)] == []


def test_every_line_in_the_life_of_a_move_stands_in_its_file():
    rows = re.findall(r"^\|\d+\|`(.+?)`\|`(.+?)`\|", (ROOT / "docs" / "move.md").read_text(), re.M)
    assert len(rows) == 12
    absent = [(path, line) for path, line in rows if line not in lines_of(ROOT / path)]
    assert absent == []


def lines_of(path):
    return [line.strip() for line in path.read_text().splitlines()]


def test_the_drawing_of_the_units_is_their_contract():
    """What one unit imports of another counts as one arrow.

    Bounds: nine floors, thirteen units, and between all but the room of agents forty-five arrows.
    """
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = {
        contract["name"]: contract for contract in pyproject["tool"]["importlinter"]["contracts"]
    }
    layers = contracts["layers of humanplay"]["layers"]
    text = (ROOT / "docs" / "architecture.md").read_text()
    drawn = [
        (line[4:14], line[14:24], line[24:34]) for line in re.findall(r"^\d   .*$", text, re.M)
    ]
    assert [[name.strip() for name in floor if name.strip()] for floor in drawn] == [
        layer.split(" | ") for layer in layers
    ]
    graph = grimp.build_graph("humanplay", cache_dir=None)
    arrows = {
        (module.split(".")[1], imported.split(".")[1])
        for module in graph.modules - {"humanplay"}
        for imported in graph.find_modules_directly_imported_by(module) - {"humanplay"}
        if module.split(".")[1] != imported.split(".")[1]
    }
    assert len(layers) <= 9
    assert len({unit for arrow in arrows for unit in arrow}) <= 13
    assert len([arrow for arrow in arrows if "agents" not in arrow]) <= 45
