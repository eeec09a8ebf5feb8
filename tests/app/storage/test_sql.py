"""SQL stands in `db`, in the release writer and in the agents' room."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SPEAKERS = ("app/humanplay/agents", "app/humanplay/db", "app/humanplay/release")
STATEMENT = re.compile(
    r"""\s*(select\s.+\sfrom\s | select\s+1\b | insert\s+(or\s+\w+\s+)?into\s | update\s+(or\s+\w+\s+)?\w+\s+set\s
    | delete\s+from\s | (create|drop)\s+(unique\s+|temp\s+)?(table|index|view|trigger)\s | alter\s+table\s | pragma\s+\w
    | attach\s+database\b | vacuum\b | begin\s+immediate\b | savepoint\s)""",
    re.IGNORECASE | re.VERBOSE | re.DOTALL,
)
CALLS = {"execute", "executemany", "executescript", "query"}
"""Methods of a connection, and of a Reader, that take SQL."""


def find_sql(source):
    """Return (line, text) of every SQL string, and of every call that takes one."""
    tree = ast.parse(source)
    texts = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)
    }  # docstrings and their like
    statements = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            text = "".join(
                part.value if isinstance(part, ast.Constant) else "x" for part in node.values
            )
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts
        ):
            text = node.value
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in CALLS
            and "Layout" not in ast.unparse(node.func.value)  # matplotlib's, which executes no SQL
        ):
            statements.append((node.lineno, f".{node.func.attr}("))
            continue
        else:
            continue
        if STATEMENT.match(text):
            statements.append((node.lineno, text))
    return statements


def test_no_other_folder_speaks_sql():
    paths = [path for package in ("app", "marsexplorer") for path in (ROOT / package).rglob("*.py")]
    assert len(paths) > 100
    places = [
        f"{path.relative_to(ROOT)}:{line}: {text[:60]}"
        for path in paths
        if not path.relative_to(ROOT).as_posix().startswith(SPEAKERS)
        for line, text in find_sql(path.read_text())
    ]
    assert places == []


@pytest.mark.parametrize("folder", SPEAKERS)
def test_the_search_finds_sql_where_it_does_stand(folder):
    statements = [
        text for path in (ROOT / folder).rglob("*.py") for _, text in find_sql(path.read_text())
    ]
    assert any(text.lower().startswith("select") for text in statements)
    assert any(text.startswith(".execute") for text in statements)
