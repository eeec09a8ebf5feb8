"""A count agrees with its noun and verb."""

import ast
import re
from pathlib import Path

import pytest

from humanplay.task import counted

ROOT = Path(__file__).parents[1]
PLURALS = (
    "people|participants|episodes|players|moves|steps|terrains|rounds|invitations|links|questions|"
    "studies|rows|cols|entries|files|values|agents|cards|boards|scripts|labels|databases|networks|"
    "sessions|operators|ids"
)
AFTER_A_COUNT = re.compile(rf"\s+(?:(?!of\b|what\b|no\b)[\w-]+\s+)?(?:{PLURALS})\b")
AFTER_COUNTED = re.compile(r"\s+(?:were|was|are|is|have|has)\b")
TEXTS = {"phase"}
"""Names of values that are words and no numbers."""


@pytest.mark.parametrize(
    ("phrase", "sentence"),
    [
        ((1, "player"), "1 player"),
        ((0, "player"), "0 players"),
        ((1234, "ranked episode"), "1,234 ranked episodes"),
        ((1, "person was", "people were"), "1 person was"),
        ((3, "person was", "people were"), "3 people were"),
    ],
)
def test_a_count_brings_noun_and_verb(phrase, sentence):
    assert counted(*phrase) == sentence


def uncounted(path):
    """The f-strings of a module in which a number of any size stands before a plural."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.JoinedStr):
            continue
        for value, text in zip(node.values, node.values[1:], strict=False):
            if not (isinstance(value, ast.FormattedValue) and isinstance(text, ast.Constant)):
                continue
            number = ast.unparse(value.value)
            if number.startswith("counted("):
                is_wrong = AFTER_COUNTED.match(text.value)
            else:
                form = "" if value.format_spec is None else ast.unparse(value.format_spec)
                is_whole = form in ("", "f','") and value.conversion == -1
                is_text = (
                    number in TEXTS or number.isupper() or "title" in number or "join" in number
                )
                is_wrong = is_whole and not is_text and AFTER_A_COUNT.match(text.value)
            if is_wrong:
                yield f"{path.relative_to(ROOT)}: {number}{text.value}"


def test_no_number_stands_before_a_plural_in_python():
    paths = [
        path
        for path in (ROOT / "app").rglob("*.py")
        if path.parent != ROOT / "app/humanplay/tasks/mars/cli"
    ]
    lines = [line for path in paths for line in uncounted(path)]  # trainings have many moves
    assert lines == []


def test_no_number_stands_before_a_plural_in_a_template():
    places = []
    for path in [*(ROOT / "app").rglob("*.j2"), *(ROOT / "app").rglob("*.txt")]:
        for match in re.finditer(rf"\{{+([^{{}}]*)\}}+{AFTER_A_COUNT.pattern}", path.read_text()):
            if "format" not in match[1] and not match[1].strip().startswith("%"):
                places.append(f"{path.relative_to(ROOT)}: {match[0]}")
    assert places == []


def test_no_number_stands_before_a_plural_on_a_page():
    places = []
    for path in (ROOT / "static").rglob("*.js"):
        for match in re.finditer(rf"\$\{{([^{{}}]*)\}}{AFTER_A_COUNT.pattern}", path.read_text()):
            is_number = not re.search(r"toFixed|shown\(|[Nn]ame\(|many\(|title|each", match[1])
            if is_number and "static/vendor" not in str(path):
                places.append(f"{path.relative_to(ROOT)}: {match[0]}")
    assert places == []
