"""The templates of the pages: those of `static/`, the documentation of the API, and the pages of errors."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.requests import HTTPConnection, Request

from humanplay import STATIC

environment = Environment(
    loader=FileSystemLoader([Path(__file__).parent, STATIC]), autoescape=True,
    undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip


def addresses(request: Request) -> dict[str, object]:
    """Return the addresses that every page has: of the app's root, of the files, and the pages that are offered."""
    root, state = root_of(request), request.app.state
    return {"root": root, "files": root + state.files.address(), "offered": state.offered}


def root_of(connection: HTTPConnection) -> str:
    """Return the relative address of the app's root as a browser sees it from the address that was asked for: "" or "../"s."""
    return "../" * (path_of(connection).count("/") - 1)


def path_of(connection: HTTPConnection) -> str:
    """Return the path that was asked for, below the app's own prefix."""
    scope = connection.scope
    prefix = scope.get("app_root_path", scope.get("root_path", ""))
    return str(scope["path"]).removeprefix(str(prefix))
