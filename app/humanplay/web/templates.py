"""The templates of the pages.

They are those of `static/`, the documentation of the API, and the pages of errors.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from starlette.requests import HTTPConnection, Request

from humanplay import STATIC
from humanplay.study.protocol import SOURCE_LANGUAGE
from humanplay.study.wording import Wording
from humanplay.task.registration import DEFAULT_TASK, environment_of
from humanplay.web.protection import is_secure

environment = Environment(
    loader=FileSystemLoader([Path(__file__).parent, STATIC]), autoescape=True,
    undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip


def page_text(wording: Wording) -> Callable[[str, str], Markup]:
    """The `t` of templates: the text of an ID with its marks, or the English."""
    return lambda ident, english: Markup(wording.text(ident, english))


environment.globals["t"] = page_text(Wording(SOURCE_LANGUAGE, {}))


def names_of(task: str) -> dict[str, object]:
    """What the pages of a task say of it: `world`, `brand` and `site_name`.

    `world` is its environment.
    """
    world = environment_of(task)
    return {
        "world": world,
        "brand": world.about.title if task == DEFAULT_TASK else "Playground",
        "site_name": f"{world.about.title} Playground",
    }


def addresses(request: Request) -> dict[str, object]:
    """What every page has: its addresses, the pages that are offered, and names.

    The names are those of what is played and of the site.
    """
    root, state, address = root_of(request), request.app.state, absolute_address(request)
    folder = state.files.address()
    return {
        "root": root,
        "files": root + folder,
        "offered": state.offered,
        **state.names,
        "address": address,
        "site": f"{address.removesuffix(path_of(request))}/",
        "folder": folder,
    }


def absolute_address(request: Request) -> str:
    """The address that was asked for, without its query, as others open it.

    It begins with the server's public address, else as whoever asked wrote it.
    """
    headers, public = request.headers, request.app.state.public_url
    prefix = headers.get("x-forwarded-prefix", "").split(",")[0].strip().rstrip("/")
    scheme = "https" if is_secure(request) else "http"
    asked = f"{scheme}://{headers.get('host', '')}{prefix}"
    return f"{asked if public is None else public.rstrip('/')}{request.url.path}"


def root_of(connection: HTTPConnection) -> str:
    """The relative address of the app's root, as a browser sees it: "" or "../"s.

    It is relative to the address that was asked for.
    """
    return "../" * (path_of(connection).count("/") - 1)


def path_of(connection: HTTPConnection) -> str:
    """The path that was asked for, below the app's own prefix."""
    scope = connection.scope
    prefix = scope.get("app_root_path", scope.get("root_path", ""))
    return str(scope["path"]).removeprefix(str(prefix))
