"""A name says what a thing is, and the first line of a docstring is read once."""

import ast

import pytest

from humanplay import ROOT

PARTS = ("app", "marsexplorer", "research", "examples", "tests")
VAGUE = {
    "each", "found", "told", "said", "given", "kept", "made", "known", "own", "what", "why", "where",
}  # fmt: skip
"""Names that no local and no parameter has: name the thing itself."""
WIDTH = 80
"""The most characters of a docstring's first line."""
Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def nodes_in(part):
    """(path and line, node) of every node in a part's modules."""
    for path in sorted((ROOT / part).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}", node


def names_in(function):
    """The names of a function's locals and parameters."""
    parameters = {parameter.arg for parameter in function.args.args + function.args.kwonlyargs}
    names = (node for node in ast.walk(function) if isinstance(node, ast.Name))
    return parameters | {name.id for name in names if isinstance(name.ctx, ast.Store)}


def first_line_of(node):
    """The first line of a docstring; empty if there is none."""
    return (ast.get_docstring(node) or "").partition("\n")[0]


@pytest.mark.parametrize("part", PARTS)
def test_names_say_what_a_thing_is_and_docstrings_begin_short(part):
    vague, long = [], []
    for place, node in nodes_in(part):
        if isinstance(node, Function):
            vague += [f"{place} {name}" for name in sorted(names_in(node) & VAGUE)]
        if isinstance(node, Documented) and len(first_line_of(node)) > WIDTH:
            long.append(place)
    assert vague == []
    assert long == []
