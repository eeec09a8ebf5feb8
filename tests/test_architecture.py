"""The house as built is the house as drawn: who imports whom, checked against docs/architecture.md."""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ALWAYS = set(sys.stdlib_module_names) | {"__future__"}


def table():
    """The rows of the table: {module or folder: the names it may import}."""
    text = (ROOT / "docs/architecture.md").read_text().split("```")[1]
    doors, room = {}, ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) == 3:
            doors |= {f"{room}/{name.rstrip('/')}": cells[2] for name in cells[0].split()}
        elif line and not line.startswith(" "):
            room = line.split("/")[0]
    return doors


def imports(path):
    """Every module a file imports, anywhere in it, by full name."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            if node.module in ("marsexplorer", "app"):
                yield from (f"{node.module}.{alias.name}" for alias in node.names)
            else:
                yield node.module


def files():
    return sorted(path for room in ("marsexplorer", "app") for path in (ROOT / room).rglob("*.py") if path.stem != "__init__")


def door_names(row):
    """What a row of the table opens: packages and sibling modules, in words, those for one module of a folder included."""
    return set(re.findall(r"[A-Za-z_0-9]+", row.replace("never world", "").replace("-", "_")))


@pytest.mark.parametrize("path", files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_imports_only_what_the_table_opens_to_it(path):
    relative = path.relative_to(ROOT)
    doors = table()
    key = str(relative) if str(relative) in doors else str(relative.parent)
    assert key in doors, f"{relative} has no row in docs/architecture.md"
    allowed = door_names(doors[key])
    for name in imports(path):
        parts = name.split(".")
        if parts[0] in ALWAYS:
            continue
        if parts[0] not in ("marsexplorer", "app"):
            assert parts[0] in allowed or "everything" in allowed, f"{relative} imports {name}"
            continue
        inner = parts[1] if len(parts) > 1 else ""
        same_folder = key == str(relative.parent) and parts[: len(relative.parent.parts)] == list(relative.parent.parts)
        opened = inner in allowed or (parts[0] in allowed and parts[0] != relative.parts[0]) or "everything" in allowed
        assert opened or same_folder, f"{relative} imports {name}"
        if inner in ("rules", "world") and "policies" in relative.parts:
            pytest.fail(f"{relative} sees the world: a policy decides from the observation alone")


def test_the_core_knows_nothing_of_the_web():
    for path in (ROOT / "marsexplorer").rglob("*.py"):
        for name in imports(path):
            assert name.split(".")[0] not in {"app", "fastapi", "starlette", "uvicorn", "viser", "sqlite_utils", "pydantic"}


def test_every_row_of_the_table_exists():
    for name in table():
        assert (ROOT / name).exists(), f"docs/architecture.md names {name}"
