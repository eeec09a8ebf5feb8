"""The page's pure modules under node's own runner, and what can be said about its files without a browser."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import get_args

import pytest

from app import protocol
from marsexplorer.config import ACTIONS, OUTCOMES

ROOT = Path(__file__).parent.parent.parent
STATIC = ROOT / "static"
MODULES = sorted(STATIC.glob("*.js"))


def test_the_pure_modules_pass_under_node():
    node = shutil.which("node")
    if node is None:
        pytest.skip("NO NODE: the page's pure modules were not tested; install node 20 or newer")
    done = subprocess.run(
        [node, "--test", *map(str, sorted(Path(__file__).parent.glob("*.test.mjs")))],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    if "bad option: --test" in done.stderr:
        pytest.skip("OLD NODE: the page's pure modules were not tested; install node 20 or newer")
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"# pass [1-9]", done.stdout)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_a_module_is_checked_small_and_alone(path):
    text = path.read_text()
    assert text.startswith("// @ts-check\n")
    assert len(text.splitlines()) <= 250
    for name in re.findall(r'^import .*?from "([^"]+)"', text, re.M):
        assert (STATIC / name).is_file(), f"{path.name} imports {name}: the page runs from its own files"
    if path.name != "main.js":
        assert "main.js" not in re.findall(r'from "\./([^"]+)"', text)


def test_the_page_asks_nobody_but_us():
    for path in [STATIC / "index.html", STATIC / "style.css", *MODULES]:
        strange = set(re.findall(r"https?://[\w.]+", path.read_text()))
        assert not strange, f"{path.name} names {strange}"


def test_the_addresses_in_the_page_are_relative():
    found = re.findall(r'(?:href|src|action)="([^"]*)"', (STATIC / "index.html").read_text())
    assert found
    assert not [url for url in found if url.startswith("/")]


def test_every_id_the_page_looks_up_is_there():
    html = (STATIC / "index.html").read_text()
    ids = set(re.findall(r'\bid="([^"]+)"', html))
    for path in MODULES:
        asked = set(re.findall(r'(?:\bby|getElementById)\("([^"]+)"\)', path.read_text()))
        assert asked <= ids, f"{path.name} looks for {asked - ids}"


def luminance(colour):
    """The relative luminance of "#rrggbb" (WCAG 2)."""
    parts = [int(colour[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one, other):
    bright, dark = sorted([luminance(one), luminance(other)], reverse=True)
    return (bright + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("ink", ["text", "muted", "accent", "rival", "alarm"])
@pytest.mark.parametrize("ground", ["night", "panel", "raised"])
def test_text_stands_out_from_its_ground(ink, ground):
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", (STATIC / "style.css").read_text()))
    assert contrast(colours[ink], colours[ground]) >= 4.5


def test_the_board_reads_in_greyscale():
    board = (STATIC / "board.js").read_text()
    unknown, free, obstacle = (re.search(rf'"{re.escape(mark)}": "(#[0-9a-f]{{6}})"', board).group(1) for mark in "?.#")
    style = (STATIC / "style.css").read_text()
    rover = re.search(r"--accent: (#[0-9a-f]{6})", style).group(1)
    order = [luminance(colour) for colour in (unknown, free, rover, obstacle)]
    assert order == sorted(order), "as in the paper: 0, 0.3, 0.6, 1"
    assert all(
        contrast(dark, bright) > 1.35 for dark, bright in zip([unknown, free, rover], [free, rover, obstacle], strict=True)
    )


def listed(name):
    """The strings of an exported list in static/protocol.js."""
    text = (STATIC / "protocol.js").read_text()
    return re.findall(r'"([^"]+)"', re.search(rf"export const {name} = .*?\[(.*?)\]", text, re.S).group(1))


def test_the_page_and_the_server_name_the_same_messages():
    assert listed("FRAME_FIELDS") == [field.alias or name for name, field in protocol.Frame.model_fields.items()]
    assert listed("ACTIONS") == list(ACTIONS)
    assert listed("OUTCOMES") == [name for name in OUTCOMES if name != "running"]
    sent = [protocol.Act.model_fields["kind"].default, *get_args(protocol.AskHistory.model_fields["kind"].annotation)]
    assert listed("TO_SERVER") == sent
    act = (STATIC / "protocol.js").read_text()
    for name in protocol.Act.model_fields:
        assert re.search(rf"\b{name}\b", act), f"an act carries {name}"
