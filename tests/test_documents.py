"""What the documents show in Python runs, block after block, and the environment's page keeps Gymnasium's headings."""

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

from app.cli.main import cli

ROOT = Path(__file__).parents[1]
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


def lacking(words):
    """Return what a command of `marsexplorer` cannot do without and was not given; None for nothing."""
    command = cli
    while isinstance(command, click.Group):
        name, *words = words
        command = command.get_command(click.Context(command), name)
    try:
        command.make_context(name, list(words))
    except click.MissingParameter as error:
        return error.format_message() if isinstance(error.param, click.Option) else None
    except click.UsageError:  # LEVEL or [--json FILE] stands for something
        return None


def test_no_command_that_is_shown_with_options_lacks_one():
    shown = []
    for path in (ROOT / "docs").glob("*.md"):
        text = path.read_text().replace("\\\n", " ")
        shown += re.findall(r"^marsexplorer ([^#\n]* --[^#\n]*)", text, re.M)
        shown += re.findall(r"`marsexplorer ([^`]*\s--[^`]*)`", text)
    assert len(shown) > 50
    found = {words: lacking(shlex.split(words)) for words in shown}
    assert {words: what for words, what in found.items() if what} == {}


def test_the_environments_page_has_gymnasiums_headings_in_their_order():
    found = re.findall(r"^## (.*)$", (ROOT / "docs/environment.md").read_text(), re.M)
    assert [heading for heading in found if heading in HEADINGS] == HEADINGS


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
    env = {"MPLBACKEND": "agg", "PYTHONPATH": str(ROOT), "PATH": "", "OMP_NUM_THREADS": "1"}
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
    assert {
        "index.html",
        "readme.html",
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
    assert 'href="study.html"' in pages["readme.html"]
    assert "--board-ground: #" in (tmp_path / "site/colours.css").read_text()
    for name, text in pages.items():
        assert not re.findall(
            r'<(?:script|link rel="stylesheet")[^>]*(?:src|href)="https?:', text
        ), name


def test_every_document_is_in_the_sites_navigation():
    listed = set(re.findall(r"- ([\w]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    assert {path.name for path in (ROOT / "docs").glob("*.md")} <= listed


@pytest.mark.parametrize("page", ["security.md", "reliability.md"])
def test_every_test_that_a_page_names_exists(page):
    """A file of tests where a path stands, a test of that name somewhere where a name, or its beginning, stands."""
    words = set(
        re.findall(r"(?:tests/[\w/]+\.py|\btest_\w+\b(?!\.py))", (ROOT / "docs" / page).read_text())
    )
    files = {word for word in words if word.endswith(".py")}
    assert files
    assert [path for path in sorted(files) if not (ROOT / path).is_file()] == []
    written = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name in sorted(words - files) if not re.search(rf"def {name}", written)] == []


def test_the_drawing_of_the_units_is_their_contract():
    """Ten units at most on seven floors; what one imports of another counts as one arrow, of which there are at most 35."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = {each["name"]: each for each in pyproject["tool"]["importlinter"]["contracts"]}
    layers = contracts["ten units of app on seven floors"]["layers"]
    text = (ROOT / "docs" / "architecture.md").read_text()
    drawn = [(line[4:14], line[14:27]) for line in re.findall(r"^\d   .*$", text, re.M)]
    assert [[name.strip() for name in floor if name.strip()] for floor in drawn] == [
        each.split(" | ") for each in layers
    ]
    graph = grimp.build_graph("app", cache_dir=None)
    arrows = {
        (module.split(".")[1], imported.split(".")[1])
        for module in graph.modules - {"app"}
        for imported in graph.find_modules_directly_imported_by(module) - {"app"}
        if module.split(".")[1] != imported.split(".")[1]
    }
    assert len(layers) <= 7
    assert len({unit for arrow in arrows for unit in arrow}) <= 10
    assert len(arrows) <= 35
