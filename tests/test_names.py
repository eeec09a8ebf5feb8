"""A name says what a thing is, and the first line of a docstring is read once."""

import ast

import pytest

from humanplay import ROOT

VAGUE = {
    "each", "found", "told", "said", "given", "kept", "made", "known", "own", "what", "why", "where",
}  # fmt: skip
WIDTH = 80
Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

VAGUE_NAMES = {"app": 213, "marsexplorer": 0, "research": 0, "examples": 0, "tests": 429}
"""Part -> at most so many locals and parameters with a vague name, each counted once a function."""
LONG_FIRST_LINES = {"app": 530, "marsexplorer": 0, "research": 0, "examples": 0, "tests": 247}
"""Part -> at most so many docstrings with a first line of more than WIDTH characters."""


def names_in(function: Function) -> set[str]:
    parameters = {parameter.arg for parameter in function.args.args + function.args.kwonlyargs}
    names = (node for node in ast.walk(function) if isinstance(node, ast.Name))
    return parameters | {name.id for name in names if isinstance(name.ctx, ast.Store)}


def count(part: str) -> tuple[int, int]:
    """Vague names, and long first lines."""
    vague = long = 0
    for path in (ROOT / part).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, Function):
                vague += len(names_in(node) & VAGUE)
            if isinstance(node, Documented):
                first, *_ = (ast.get_docstring(node) or "").split("\n", 1)
                long += len(first) > WIDTH
    return vague, long


@pytest.mark.parametrize("part", VAGUE_NAMES)
def test_vague_names_and_long_first_lines_do_not_become_more(part):
    """A plain name or sentence in its place makes a number smaller: write the new one above."""
    vague, long = count(part)
    assert vague <= VAGUE_NAMES[part]
    assert long <= LONG_FIRST_LINES[part]
