"""Names are the field's own: words that only this project understood once do not come back.

The words are looked for in identifiers, file names and CSS selectors. Strings and comments are exempt: columns, JSON keys,
messages and flags keep the names by which databases and clients know them.
"""

import io
import keyword
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("app", "marsexplorer", "static", "tests", "examples", "docs", "benchmarks")
BANNED = {
    "easel", "journey", "beside", "door", "doors", "told", "think", "paid", "gains", "gist", "judge", "worth", "tally",
    "haunted", "heist", "curiosity", "mind", "saver", "senses", "seat", "hands", "sheet", "pulse",
}  # fmt: skip
"""`way`, `table` and `calls` are not in the list: they have meanings in the field too (a table of a database), and no test can
decide where they are metaphors."""

SCRIPT = re.compile(
    r"""(?P<comment>//[^\n]*|/\*.*?\*/)
      | (?P<string>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')
      | (?P<regex>(?<=[(,=:\[!&|?{};\n])\s*/(?![*/])(?:\\.|\[(?:\\.|[^\]\\\n])*\]|[^/\\\[\n])+/\w*)
      | (?P<name>[A-Za-z_$][\w$]*)
      | (?P<mark>[`{}])""",
    re.S | re.X,
)


def words_of(name):
    """Return the words of a name in snake_case, camelCase or kebab-case."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def banned_in(names):
    """Return the names that contain a banned word."""
    return sorted({name for name in names if BANNED & set(words_of(name))})


def python_names(text):
    """Return the identifiers of a Python module, those inside f-strings too where Python's tokenizer shows them."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {token.string for token in tokens if token.type == tokenize.NAME and not keyword.iskeyword(token.string)}


def script_names(text):
    """Return the identifiers of a JavaScript module, those inside `${...}` of templates too."""
    found, open_marks, at = set(), [], 0
    while at < len(text):
        if open_marks and open_marks[-1] == "`":
            at, mark = end_of_template_text(text, at)
            if mark == "`":
                open_marks.pop()
            else:
                open_marks.append("{")
            continue
        match = SCRIPT.match(text, at)
        if match is None:
            at += 1
            continue
        at = match.end()
        if match["name"]:
            found.add(match["name"])
        elif match["mark"] == "}":
            open_marks = open_marks[:-1]
        elif match["mark"]:
            open_marks.append(match["mark"])
    return found


def end_of_template_text(text, at):
    """Return where the text of a template ends, and whether by "`" or by "${"."""
    match = re.compile(r"(?:\\.|\$(?!\{)|[^`\\$])*(`|\$\{|$)", re.S).match(text, at)
    return match.end(), match[1] or "`"


def style_names(text):
    """Return the names in the selectors of a style sheet, and its custom properties."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    selectors = re.findall(r"([^{}]*)\{", text)
    return set(re.findall(r"[\w-]+", " ".join(selectors))) | set(re.findall(r"--[\w-]+", text))


def markup_names(text):
    """Return the ids, the classes and the names of the data attributes of a page."""
    values = re.findall(r'\b(?:id|class|for)="([^"]*)"', text)
    return set(" ".join(values).split()) | set(re.findall(r"\b(data-[\w-]+)", text))


NAMES_OF = {".py": python_names, ".css": style_names}
NAMES_OF |= dict.fromkeys((".js", ".mjs"), script_names) | dict.fromkeys((".html", ".jinja", ".j2"), markup_names)
FILES = sorted(
    path
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and not {"__pycache__", "screenshots"} & set(path.parts)
)


@pytest.mark.parametrize("kind", NAMES_OF)
def test_no_identifier_or_selector_has_a_banned_word(kind):
    found = {}
    for path in FILES:
        if path.suffix == kind:
            names = banned_in(NAMES_OF[kind](path.read_text()))
            if names:
                found[str(path.relative_to(ROOT))] = names
    assert not found, "\n".join(f"{path}: {', '.join(names)}" for path, names in found.items())


def test_no_file_or_folder_has_a_banned_word():
    places = {place for path in FILES for place in [path, *path.parents] if place.is_relative_to(ROOT)}
    assert banned_in(place.stem for place in places) == []


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (python_names("def beside_it(seat):\n    return 'door'  # journey\n"), ["beside_it", "seat"]),
        (
            script_names("const aSheet = `mind ${easelOf(1)} door`; // tally\nconst s = 'seat', r = /pulse/;"),
            ["aSheet", "easelOf"],
        ),
        (script_names("const f = (a) => `x ${ok({ a }) ? `y ${toldYou}` : ''} gist`; let paid;"), ["paid", "toldYou"]),
        (
            style_names("/* door */ .sheet > [data-seat=player] { --pulse-width: 1px; color: worth; }"),
            ["--pulse-width", "data-seat", "sheet"],
        ),
        (markup_names('<p id="quiz-told" class="a door" data-mind="x">You think</p>'), ["data-mind", "door", "quiz-told"]),
        (["hands_on", "handshake", "thoughts", "Heist", "doorway", "openDoors"], ["Heist", "hands_on", "openDoors"]),
    ],
    ids=["python", "script", "nested template", "style", "markup", "file names"],
)
def test_each_kind_of_name_is_found(names, expected):
    assert banned_in(names) == expected
