"""A replay as one HTML file that opens from a disk: the page of the server with its modules, styles and courses inside.

A module cannot be imported from a file on a disk, so each one becomes a data URL, which the page's import map finds by name.
The file's own Content-Security-Policy lets it load nothing else.
"""

from __future__ import annotations

import base64
import re
from functools import lru_cache
from pathlib import Path

from markupsafe import Markup

from app.replay.course import Course
from app.replay.page import Inlined, render
from app.settings import STATIC

STYLES = ("common/base.css", "common/bar.css", "common/chart.css", "replay/replay.css")
"""The style sheets of the page, in its order."""
ENTRY = "replay/main.js"
_IMPORT = re.compile(r'^(import\s[^"]*?\sfrom\s+)"(\.{1,2}/[^"]+)";', re.M)


def single_file(episode_id: str, course: Course, ghost: Course | None) -> str:
    """Return the HTML of a replay that needs neither server nor network."""
    data = {
        "episode": episode_id,
        "level": course.config.level,
        "rows": course.config.rows,
        "cols": course.config.cols,
        "run": course.to_dict(),
        "ghosts": [] if ghost is None else [ghost.name],
        "preferred": None if ghost is None else ghost.name,
        "ghost": None if ghost is None else ghost.to_dict(),
    }
    return render(data, course, inlined=_inlined())


@lru_cache(maxsize=1)
def _inlined() -> Inlined:
    style = "\n".join((STATIC / name).read_text() for name in STYLES)
    icon = base64.b64encode((STATIC / "common" / "icon.svg").read_bytes()).decode()
    return Inlined(
        style=Markup(style),
        theme=Markup((STATIC / "common" / "theme.js").read_text()),
        modules={name: _data_url(text) for name, text in modules(ENTRY).items()},
        entry=ENTRY,
        icon=f"data:image/svg+xml;base64,{icon}",
    )


def modules(entry: str) -> dict[str, str]:
    """Return the text of a module and of all that it imports, by path below `static/`, each importing others by that path."""
    found: dict[str, str] = {}
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        text = (STATIC / name).read_text()

        def by_name(match: re.Match[str], folder: Path = Path(name).parent) -> str:
            target = (STATIC / folder / match[2]).resolve().relative_to(STATIC.resolve()).as_posix()
            waiting.append(target)
            return f'{match[1]}"{target}";'

        found[name] = _IMPORT.sub(by_name, text)
    return found


def _data_url(script: str) -> str:
    return f"data:text/javascript;base64,{base64.b64encode(script.encode()).decode()}"
