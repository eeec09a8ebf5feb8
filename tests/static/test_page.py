"""The page's modules under node, and its files without a browser."""

import hashlib
import json
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import get_args

import pytest

from humanplay.board import messages
from humanplay.tasks.mars import messages as mars
from marsexplorer.config import ACTIONS, OUTCOMES, EnvConfig
from tests.support.words_of_mars import words_of_mars

ROOT = Path(__file__).parent.parent.parent
STATIC = ROOT / "static"
VENDOR = STATIC / "vendor"
"""Libraries of others, as they were published."""
MODULES = sorted(path for path in STATIC.rglob("*.js") if VENDOR not in path.parents)
TYPES = sorted(path for path in STATIC.rglob("*.d.ts") if VENDOR not in path.parents)
PAGES = sorted(STATIC.glob("*/index.html"))
PARTS = sorted(STATIC.rglob("*.html"))
"""The pages, and what they include."""


def test_the_pure_modules_pass_under_node(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("NO NODE: the page's pure modules were not tested; install node 20 or newer")
    files = sorted(Path(__file__).parent.rglob("*.test.mjs"))
    together = tmp_path / "all.test.mjs"  # in one process, or each file would start one
    together.write_text("".join(f'import "{path.as_uri()}";\n' for path in files))
    done = subprocess.run(
        [node, "--test", together], capture_output=True, text=True, timeout=120, check=False
    )
    if "bad option: --test" in done.stderr:
        pytest.skip("OLD NODE: the page's pure modules were not tested; install node 20 or newer")
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"# pass [1-9]", done.stdout)


def test_an_arms_keys_are_those_that_a_person_may_choose():
    node = shutil.which("node")
    if node is None:
        pytest.skip("NO NODE: the keys that may drive were not compared; install node 20 or newer")
    script = f"""import {{ mayDrive }} from "{(STATIC / "common" / "keymap.js").as_uri()}";
        console.log(JSON.stringify({json.dumps(sorted(messages.KEY_CODES))}.filter(mayDrive)));"""
    done = subprocess.run(
        [node, "--input-type=module", "--eval", script],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert set(json.loads(done.stdout)) == messages.DRIVING_KEYS


def test_the_library_of_charts_is_the_one_that_was_published():
    folder = VENDOR / "uplot"
    published, ours = (folder / "uPlot.js").read_text().rsplit("\n", 2)[:2]
    assert ours == "export default uPlot;"
    stated = (folder / "VERSION.txt").read_text()
    assert hashlib.sha256(f"{published}\n".encode()).hexdigest() in stated
    assert re.search(r"\(v([\d.]+)\)", published[:100])[1] in stated
    assert "MIT" in stated
    assert (folder / "LICENSE").is_file()


def name_of(path):
    return str(path.relative_to(STATIC))


def page_of(module):
    """The page a module is written for: the one in its folder, else the playground."""
    page = STATIC / module.parent.name / "index.html"
    return page if page.is_file() else STATIC / "play" / "index.html"


INCLUDE = re.compile(r"{% include (.+?)(?: ignore missing)? %}")


def text_of(page, world):
    """A page in a world, with what it includes: of a choice the first that is there."""

    def included(match):
        names = re.findall(
            r'"([^"]+)"', match[1].replace('task/" ~ world.assets ~ "', f"task/{world}")
        )
        there = [STATIC / name for name in names if (STATIC / name).is_file()]
        assert there or match[0].endswith("ignore missing %}"), match[0]
        return text_of(there[0], world) if there else ""

    return INCLUDE.sub(included, page.read_text())


def part(pattern, text):
    """What a pattern's group matches first in a text."""
    return re.search(pattern, text, re.S | re.M)[1]


ANY = re.compile(r"\{any\}|[:|] any\b|<any>|\bany\[\]")


@pytest.mark.parametrize("path", [*MODULES, *TYPES], ids=name_of)
def test_a_module_is_checked_and_alone(path):
    text = path.read_text()
    assert "@ts-nocheck" not in text
    assert "@ts-ignore" not in text
    assert not ANY.search(text), "say the type"
    for name in re.findall(r'^import .*?from "([^"]+)"', text, re.M):
        assert (path.parent / name).is_file(), f"{name} is none of the page's own files"
    if path.name != "main.js":
        assert "main.js" not in re.findall(r'from "\./([^"]+)"', text)


def test_the_types_of_every_module_are_checked():
    settings = json.loads((ROOT / "tsconfig.json").read_text())
    assert settings["compilerOptions"]["checkJs"] is True
    assert settings["compilerOptions"]["strict"] is True
    assert settings["include"] == ["static"]
    assert settings["exclude"] == ["static/vendor"]


def test_the_page_asks_nobody_but_us():
    paper = r'<a href="https://(doi|arxiv)\.org/[\w./]+" rel="noreferrer">'
    for path in [*PAGES, *STATIC.rglob("*.css"), *MODULES]:
        text = re.sub(paper, "", path.read_text())
        strange = set(re.findall(r"https?://[\w.]+", text)) - {"http://www.w3.org"}  # names SVG
        assert not strange, f"{path.name} names {strange}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_addresses_in_a_page_are_relative(page):
    addresses = re.findall(r'(?:href|src|action)="([^"]*)"', page.read_text())
    assert addresses
    assert not [url for url in addresses if url.startswith("/")]


def imported_by(module):
    """The modules that a module imports, and those that they import, by page names."""
    modules, waiting = set(), [module]
    while waiting:
        path = waiting.pop()
        for name in re.findall(r'^(?:im|ex)port .*?from "([^"]+)"', path.read_text(), re.M):
            needed = (path.parent / name).resolve()
            if needed not in modules:
                modules.add(needed)
                waiting.append(needed)
    return {name_of(path) for path in modules}


def test_the_playground_asks_for_all_its_modules_at_once():
    folder = STATIC / "task" / "mars"
    page, head = STATIC / "play" / "index.html", folder / "head.html"
    preloaded = r'<link rel="modulepreload" href="{{ files }}([^"]+)">'
    asked = set(re.findall(preloaded, page.read_text() + head.read_text()))
    asked_for_by_name = [folder / "index.js", folder / "views.js"]
    needed = {name_of(path) for path in asked_for_by_name}
    for module in (STATIC / "play" / "main.js", *asked_for_by_name):
        needed |= imported_by(module)
    wrong = f"add {sorted(needed - asked)}, remove {sorted(asked - needed)}"
    assert asked == needed, f"modulepreload lines of {page.name} and {head.name}: {wrong}"


def test_the_ring_on_the_matrix_is_as_wide_as_the_lidar_sees():
    board = (STATIC / "task" / "mars" / "board.js").read_text()
    assert f"LIDAR_CELLS = {EnvConfig.of('random', 21).sensor_radius};" in board


WORLD = re.compile(
    r"""\blidar|\brover|\bobstacle|\brocks?\b|\b99\s?%|["']mars["']|\blookahead|["']ppo["']|\bfrontier""",
    re.I,
)
"""Words of MarsExplorer's world, the share of its cells that completes a terrain, its folder and its policies."""


STRING = re.compile(r"""(?P<string>"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'|`(?:[^`\\]|\\.)*`)""")


def shown_by(path):
    """A page without its notes, a module without its comments and its names."""
    text = re.sub(r"{#.*?#}|/\*.*?\*/", "", path.read_text(), flags=re.S)
    if path.suffix == ".html":
        return text
    code = re.sub(r"(?m)(^|\s)//.*$", "", text)
    # names stand between the strings; of a string only the names of attributes are none of its words
    code = re.sub(STRING.pattern + r"|\w+(?=[(:,)])", lambda part: part["string"] or "", code)
    return re.sub(r"\bdata-\w+", "", code)


def shared(paths):
    """Those that are of no world, marked by their names."""
    return [
        pytest.param(path, id=name_of(path))
        for path in paths
        if STATIC / "task" / "mars" not in path.parents
    ]


@pytest.mark.parametrize("path", shared([*MODULES, *TYPES, *PARTS]))
def test_the_words_of_a_world_stand_with_its_task_alone(path):
    assert not WORLD.findall(path.read_text())


@pytest.mark.parametrize("path", shared([*MODULES, *PARTS]))
def test_what_every_world_shows_speaks_of_none(path):
    shown = re.sub("terrain", "round", shown_by(path), flags=re.I)  # as showTask renames it
    assert words_of_mars(shown) == []


def test_no_module_of_the_server_asks_for_a_world_by_name():
    """The registration does, and the extras of the package are called as they are."""
    folder = ROOT / "app" / "humanplay"
    named = {folder / "task" / "registration.py", folder / "command" / "extras.py"}
    asked = re.compile(r"""["'](mars|lookahead|ppo|frontier-\w+)["']""")
    others = [
        path for path in folder.rglob("*.py") if folder / "tasks" / "mars" not in path.parents
    ]
    assert len(others) > 150
    assert {path for path in others if asked.search(path.read_text())} <= named


def test_the_words_of_a_world_are_found_where_they_stand():
    pages = (STATIC / "task" / "mars").glob("*.js")
    text = "".join("".join(path.read_text() for path in pages).lower().split())
    assert all(word in text for word in ("lidar", "rover", "obstacle", "rock", "99%"))


def test_commands_for_operators_stand_behind_run_one_yourself_on_visitors_pages():
    behind = re.compile(
        r"<details[^>]*>\s*<summary>Run one yourself</summary>.*?</details>", re.DOTALL
    )
    # whoever has a file verifies it
    commands = re.compile(r"\bhumanplay (?!agents verify)[a-z]+\b")
    visitors = [part for part in PARTS if part.parent.name != "admin"]
    texts = {part: part.read_text(encoding="utf-8") for part in visitors}
    assert [part for part, text in texts.items() if commands.search(behind.sub("", text))] == []
    assert sum(len(commands.findall(text)) for text in texts.values()) == 10


def test_every_id_the_page_looks_up_is_there():
    for path in MODULES:
        folder = path.relative_to(STATIC).parts[:2]
        worlds = folder[1:] if folder[0] == "task" else ("mars", "picture")
        asked = set(re.findall(r'(?:\bby|getElementById)\("([^"]+)"[,)]', path.read_text()))
        for world in worlds:
            ids = set(re.findall(r'\bid="([^"]+)"', text_of(page_of(path), world)))
            assert asked <= ids, f"{path.name} looks for {asked - ids} in {world}"


def test_the_document_names_all_that_a_browser_keeps():
    written = "".join(path.read_text() for path in MODULES)
    keys = set(re.findall(r'"(humanplay\.[\w.-]+)"', written)) - {
        "humanplay.first-frame"
    }  # a mark in time
    assert {"humanplay.theme", "humanplay.played"} <= keys
    document = (ROOT / "docs/protocol.md").read_text()
    assert [key for key in sorted(keys) if f"`{key}`" not in document] == []


def luminance(colour):
    """The relative luminance of "#rrggbb" (WCAG 2)."""
    shares = [int(colour[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    linear = [
        share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares
    ]
    return sum(
        weight * share for weight, share in zip((0.2126, 0.7152, 0.0722), linear, strict=True)
    )


def contrast(one, other):
    bright, dark = sorted([luminance(one), luminance(other)], reverse=True)
    return (bright + 0.05) / (dark + 0.05)


COLOUR = re.compile(r"--([a-z-]+): (#[0-9a-f]{6});")


def theme(selector):
    """What the first block of base.css with this selector says: colours by name."""
    block = part(rf"{re.escape(selector)} \{{(.*?)\}}", (STATIC / "common/base.css").read_text())
    colours = dict(COLOUR.findall(block))
    others = dict(re.findall(r"--([a-z-]+): var\(--([a-z]+)\)", block))
    return {name: colours[others[name]] for name in others.keys() - colours.keys()} | colours


DARK, LIGHT = ":root", ":root[data-theme=light]"


@pytest.mark.parametrize("ink", ["text", "muted", "accent", "rival", "alarm", "good"])
@pytest.mark.parametrize("ground", ["page", "page-end", "panel", "raised", "field", "notice"])
@pytest.mark.parametrize("selector", [DARK, LIGHT])
def test_text_stands_out_in_both_themes(ink, ground, selector):
    colours = theme(DARK) | theme(selector)
    assert contrast(colours[ink], colours[ground]) >= 4.5


@pytest.mark.parametrize("selector", [DARK, LIGHT])
def test_buttons_and_marks_stand_out_in_both_themes(selector):
    colours = theme(DARK) | theme(selector)
    fills = [colours[name] for name in ("accent", "accent-over", "alarm")]
    assert all(contrast(colours["ink"], fill) >= 4.5 for fill in fills)
    for mark in ("open", "chart-you", "chart-policy"):
        assert all(contrast(colours[mark], colours[ground]) >= 3 for ground in ("page", "panel"))


def palette(name):
    """The colours of a palette: those of the dark theme, replaced by palettes.css."""
    styles = (STATIC / "study/palettes.css").read_text()
    blocks = re.findall(rf":root\[data-palette={name}\].*?\{{(.*?)\}}", styles, re.S)[:1]
    return theme(DARK) | dict(COLOUR.findall("".join(blocks)))


LEAST = [("standard", 4.5), ("colour-blind", 4.5), ("high-contrast", 7)]


@pytest.mark.parametrize(("name", "least"), LEAST)
@pytest.mark.parametrize("ink", ["text", "muted", "accent", "rival", "alarm"])
@pytest.mark.parametrize("ground", ["night", "panel", "raised"])
def test_text_stands_out_from_its_ground(ink, ground, name, least):
    colours = palette(name)
    assert contrast(colours[ink], colours[ground]) >= least


@pytest.mark.parametrize("selector", [DARK, LIGHT])
def test_the_board_reads_in_greyscale(selector):
    of = theme(DARK) | theme(selector)
    order = [luminance(of[f"board-{name}"]) for name in ("unknown", "ground", "rock")]
    assert order == sorted(order, reverse=selector == LIGHT)
    assert contrast(of["board-unknown"], of["board-ground"]) > 3
    assert contrast(of["board-ground"], of["board-rock"]) > 2
    for rover in ("board-you", "board-policy"):
        assert contrast(of["board-ground"], of[rover]) > 2
        assert contrast(of["board-casing"], of[rover]) > 7, "it tells a rover from a rock"


def test_the_board_of_a_study_keeps_its_lightness():
    board = (STATIC / "task/mars/board.js").read_text()
    unknown, free, rock = json.loads(re.search(r"const MARS_SHADES = (\{.*\});", board)[1]).values()
    order = [luminance(colour) for colour in (unknown, free, palette("standard")["accent"], rock)]
    assert order == sorted(order), "as in the paper: 0, 0.3, 0.6, 1"
    assert all(dark / bright < 0.75 for dark, bright in pairwise(order))


@pytest.mark.parametrize(("name", "least"), [("colour-blind", 1.35), ("high-contrast", 3.9)])
def test_the_boards_of_the_study_read_in_greyscale(name, least):
    block = (STATIC / "task/mars/board.js").read_text().split(f'"{name}": {{')[1]
    shades = [rf'"{re.escape(mark)}": "(#[0-9a-f]{{6}})"' for mark in "?.#"]
    unknown, free, rock = (part(shade, block) for shade in shades)
    rover = palette(name)["accent"]
    assert contrast(unknown, free) > least
    assert contrast(free, rover) > least
    assert contrast(free, rock) > least


def listed(name):
    """The strings of an exported list in static/common/messages.js."""
    text = (STATIC / "common/messages.js").read_text()
    return re.findall(r'"([^"]+)"', part(rf"export const {name} = .*?\[(.*?)\]", text))


def kinds(model):
    """The kinds of message that a model is of."""
    return get_args(model.model_fields["kind"].annotation)


def test_the_page_and_the_server_name_the_same_messages():
    answers = [
        message
        for message in messages.ServerMessage.__subclasses__()
        if message.__module__ == messages.__name__
    ]
    texts = messages.encode_refused("", "null"), messages.encode_error("")
    named = {json.loads(text)["kind"] for text in texts}
    named.update(kind for model in (mars.Frame, mars.History, *answers) for kind in kinds(model))
    assert sorted(listed("FROM_SERVER")) == sorted(named)
    about = (ROOT / "tests/static/task/mars/about.mjs").read_text()
    assert re.findall(r'"(\w+)"', part(r"actions: \[(.*?)\]", about)) == list(ACTIONS)
    assert get_args(mars.EpisodeOutcome) == OUTCOMES[1:]
    asked = (messages.HistoryRequest, messages.Events)
    sent = [
        messages.Act.model_fields["kind"].default,
        *(kind for model in asked for kind in kinds(model)),
    ]
    act = (STATIC / "common/messages.js").read_text()
    assert sorted(re.findall(r'return \{ kind: "(\w+)"', act)) == sorted(sent)
    types = (STATIC / "common/types.d.ts").read_text()
    carried = part(r'\{ (kind: "act", .*?), \.\.\.timing \}', act)
    carried = {name.split(":")[0] for name in carried.split(", ")} | {
        "client_ms",
        *re.findall(r'"(\w+)"', part(r"^type Timing = (.*?);", types)),
    }
    assert carried == set(messages.Act.model_fields)
