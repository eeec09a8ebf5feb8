"""The page of a replay, from the template `static/replay/index.html`.

It is as the server gives it, or whole in one file. The file opens from a disk: it holds the page
with its modules, styles and courses. A module cannot be imported from a file on a disk, so each one
becomes a data URL, which the page's import map finds by name. The file's own
Content-Security-Policy lets it load nothing else.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

from markupsafe import Markup

from humanplay import STATIC
from humanplay.task import Course, describe, place_of
from humanplay.task.registration import environment_of, static_of
from humanplay.web import templates
from humanplay.web.files import joined

STYLES = "replay/index.css"
ENTRY = "replay/main.js"
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
    """The HTML of a replay.

    Args:
        data: What the page draws.
        course: That of the episode itself.
        addresses: Of the app's root and of the page's files.
        formats: In which the server gives the replay as a file.
        address: Of the page, absolute, for whoever shows a preview of the link.
        inlined: What a page that stands in one file holds itself, see `_inlined`.
    """
    site = {**addresses, **templates.names_of(course.task), "address": address}
    text: str = templates.environment.get_template("replay/index.html").render(
        **site,
        data=data,
        headline=course.headline,
        terrain=data["place"],
        formats=formats,
        inlined=inlined,
    )
    return text


def document(
    episode_id: str, course: Course, ghosts: Sequence[str], preferred: str | None
) -> dict[str, object]:
    """What the page of a replay reads; no seed, no player and no session is in it."""
    environment = environment_of(course.task)
    return {
        "episode": episode_id,
        "place": place_of(environment, course.config),
        "task": describe(environment),
        "run": course.to_dict(),
        "ghosts": list(ghosts),
        "preferred": preferred,
    }


def single_file(episode_id: str, course: Course, ghost: Course | None) -> str:
    """The HTML of a replay that needs neither server nor network."""
    name, shown = (None, None) if ghost is None else (ghost.name, ghost.to_dict())
    data = document(episode_id, course, [] if name is None else [name], name)
    return render({**data, "ghost": shown}, course, inlined=_inlined(course.task))


@lru_cache(maxsize=16)
def _inlined(task: str) -> dict[str, object]:
    """What a page in one file holds: its styles, modules and icon.

    The script that chooses the theme comes as text; modules by name and the icon come as data URLs.
    """
    style = joined(STYLES, lambda name: (STATIC / name).read_bytes()).decode()
    icon = base64.b64encode((STATIC / "common" / "icon.svg").read_bytes()).decode()
    return {
        "style": Markup(style),
        "theme": Markup((STATIC / "common" / "theme.js").read_text()),
        "modules": {name: _data_url(text) for name, text in modules(ENTRY, task).items()},
        "entry": ENTRY,
        "icon": f"data:image/svg+xml;base64,{icon}",
    }


def modules(entry: str, task: str) -> dict[str, str]:
    """The texts of a module, of a task's and of all that they import.

    Returns:
        By path below `static/`, by which they import.
    """
    texts: dict[str, str] = {}
    of_task = f"task/{environment_of(task).assets}"
    waiting = [entry, f"{of_task}/index.js"]
    while waiting:
        name = waiting.pop()
        if name in texts:
            continue
        world = static_of(task) if name.startswith(f"{of_task}/") else None
        path = STATIC / name if world is None else world / name.removeprefix(f"{of_task}/")

        def by_name(match: re.Match[str], folder: Path = Path(name).parent) -> str:
            target = (STATIC / folder / match[2]).resolve().relative_to(STATIC.resolve()).as_posix()
            waiting.append(target)
            return f'{match[1]}"{target}";'

        text = _IMPORT.sub(by_name, path.read_text())
        texts[name] = text.replace(_TASK_IMPORT, "import(`task/")
    return texts


def _data_url(script: str) -> str:
    return f"data:text/javascript;base64,{base64.b64encode(script.encode()).decode()}"
