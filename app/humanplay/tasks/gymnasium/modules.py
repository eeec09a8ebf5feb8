"""A user's own modules, imported from the working folder and hashed."""

from __future__ import annotations

import hashlib
import re
import sys
from functools import cache
from importlib import import_module
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

OURS = ("gymnasium", "humanplay")
"""Packages whose versions an episode has anyway."""


def imported(name: str) -> ModuleType:
    """Import a module; one that is not installed is looked for in the working folder.

    Raises:
        ModuleNotFoundError: Neither it nor one that it needs is there.
    """
    top = name.partition(".")[0]
    if find_spec(top) is None and _is_in(Path.cwd(), top):
        # at the end: a file that happens to lie here never stands in for an installed module
        sys.path.append(str(Path.cwd()))
    return import_module(name)


def module_of_file(path: Path) -> str:
    """Return the name by which a Python file is imported from now on.

    Raises:
        OSError: It cannot be read.
        ValueError: Another module of that name is installed.
    """
    path.open("rb").close()
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    spec = find_spec(path.stem)
    if spec is None or spec.origin is None or Path(spec.origin).resolve() != path.resolve():
        raise ValueError(
            f"{path} cannot be imported: another module is called {path.stem!r}; rename the file"
        )
    return path.stem


def _is_in(folder: Path, name: str) -> bool:
    return (folder / f"{name}.py").is_file() or (folder / name / "__init__.py").is_file()


@cache
def owners_of(name: str) -> tuple[str, ...]:
    """The installed packages that bring a top-level module; none for a user's own."""
    # `packages_distributions` parses every file of every package, which takes half a second
    files = re.compile(rf'^"?{re.escape(name)}(/|\.[^/,]+,)', re.MULTILINE)
    owners = set[str]()
    for package in distributions():
        modules = package.read_text("top_level.txt")
        is_owner = (
            name in modules.split() if modules else files.search(package.read_text("RECORD") or "")
        )
        if is_owner:
            owners.add(package.metadata["Name"])
    return tuple(sorted(owners))


@cache
def source_hash(name: str) -> str:
    """SHA-256 (hex) of a user's own module, with everything in its package.

    Empty for a module that a package brings, for one that has no source, and for a script or a
    notebook, which is another `__main__` in each process.
    """
    top = name.partition(".")[0]
    if top in (*OURS, "__main__") or owners_of(top):
        return ""
    spec = find_spec(top)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return ""
    origin = Path(spec.origin)
    folder = origin.parent
    files = sorted(folder.rglob("*.py")) if spec.submodule_search_locations else [origin]
    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes()
        digest.update(f"{file.relative_to(folder).as_posix()}\n{len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
