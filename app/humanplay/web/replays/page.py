"""The page of a replay, from the template `static/replay/index.html`: as the server gives it, or whole in one file.

The file opens from a disk: it holds the page with its modules, styles and courses. A module cannot be imported from a file on a
disk, so each one becomes a data URL, which the page's import map finds by name. The file's own Content-Security-Policy lets it
load nothing else.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

from markupsafe import Markup

from humanplay import STATIC
from humanplay.task import Course
from humanplay.web.files import joined
from humanplay.web.templates import environment

STYLES = "replay/index.css"
ENTRY = "replay/main.js"
TASKS = ("task/mars/index.js", "task/picture/index.js")
"""What the page asks for by the assets of its task."""
AT_HOME = {"root": "", "files": ""}
"""Of a page that stands in one file."""
_IMPORT = re.compile(r'^((?:im|ex)port\s[^"]*?\sfrom\s+)"(\.{1,2}/[^"]+)";', re.M)
_TASK_IMPORT = "import(`../task/"


def render(
    data: dict[str, object],
    course: Course,
    addresses: Mapping[str, object] = AT_HOME,
    formats: Sequence[str] = (),
    address: str | None = None,
    inlined: dict[str, object] | None = None,
) -> str:
    """Return the HTML of a replay; `data` is what the page draws, `course` that of the episode itself.

    addresses  of the app's root and of the page's files
    formats  in which the server gives the replay as a file
    address  of the page, absolute, for whoever shows a preview of the link
    inlined  what a page that stands in one file holds itself, see `_inlined`
    """
    about = course.about()
    terrain = course.place
    if "task" not in about:
        terrain += f", {about['rows']} \u00d7 {about['cols']} cells"
    text: str = environment.get_template("replay/index.html").render(
        **addresses, data=data, headline=course.headline, terrain=terrain,
        formats=formats, address=address, inlined=inlined,
    )  # fmt: skip
    return text


def document(
    episode_id: str, course: Course, ghosts: Sequence[str], preferred: str | None
) -> dict[str, object]:
    """Return what the page of a replay reads; no seed, no player and no session is in it."""
    told = {"run": course.to_dict(), "ghosts": list(ghosts), "preferred": preferred}
    return {"episode": episode_id, **course.about(), **told}


def single_file(episode_id: str, course: Course, ghost: Course | None) -> str:
    """Return the HTML of a replay that needs neither server nor network."""
    name, shown = (None, None) if ghost is None else (ghost.name, ghost.to_dict())
    data = document(episode_id, course, [] if name is None else [name], name)
    return render({**data, "ghost": shown}, course, inlined=_inlined())


@lru_cache(maxsize=1)
def _inlined() -> dict[str, object]:
    """Return styles and the script that chooses their theme; modules by name and the icon, as data URLs."""
    style = joined(STYLES, lambda name: (STATIC / name).read_bytes()).decode()
    icon = base64.b64encode((STATIC / "common" / "icon.svg").read_bytes()).decode()
    return {
        "style": Markup(style),
        "theme": Markup((STATIC / "common" / "theme.js").read_text()),
        "modules": {name: _data_url(text) for name, text in modules(ENTRY).items()},
        "entry": ENTRY,
        "icon": f"data:image/svg+xml;base64,{icon}",
    }


def modules(entry: str) -> dict[str, str]:
    """Return the text of a module, of the tasks and of all that they import, by path below `static/`, by which they import."""
    found: dict[str, str] = {}
    waiting = [entry, *TASKS]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        text = (STATIC / name).read_text()

        def by_name(match: re.Match[str], folder: Path = Path(name).parent) -> str:
            target = (STATIC / folder / match[2]).resolve().relative_to(STATIC.resolve()).as_posix()
            waiting.append(target)
            return f'{match[1]}"{target}";'

        found[name] = _IMPORT.sub(by_name, text).replace(_TASK_IMPORT, "import(`task/")
    return found


def _data_url(script: str) -> str:
    return f"data:text/javascript;base64,{base64.b64encode(script.encode()).decode()}"
