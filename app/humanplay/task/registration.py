"""The registered tasks by name, and the default one.

A world of one's own is a package with the modules `environment` and `task`, and a folder `static` of what draws it. An entry
point of the group `humanplay.tasks` registers it, or its folder (`serve --env FOLDER`, the variable HUMANPLAY_WORLDS).
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from humanplay.task import Environment, Policies, Task

DEFAULT_TASK = "mars"
"""What is played where no task is named."""


@dataclass(frozen=True)
class Registration:
    """A task, or a family of tasks whose names begin alike.

    package  has a module `environment` with a function `environment(variant)`, and a module `task` with `serve(variant, start)`
    extras   of the package humanplay that must be installed to play it; the last one includes the others
    """

    package: str
    extras: tuple[str, ...] = ()


REGISTERED = {
    DEFAULT_TASK: Registration("humanplay.tasks.mars", ("mars", "play")),
    "gymnasium": Registration("humanplay.tasks.gymnasium"),
}
"""By the part of a task's name before its colon; what follows it is the variant."""
WORLDS = "HUMANPLAY_WORLDS"
"""The variable that holds the folders of further worlds, which processes beside this one read as well."""


@dataclass(frozen=True)
class Start:
    """What a server gives the task that it offers.

    policies          files of further policies, or functions
    maps              files of instances, where the task takes some; `cell_m` is the side of their cells in metres
    hidden            files and folders that nothing which is played may read
    confined          whether what is played, and its policies, may do no more than they need
    compiles_beside   whether a process beside this one compiles what is missing, from now until the task is closed
    loaded            what is on offer, where that is loaded already
    """

    policies: tuple[Path, ...] = ()
    maps: tuple[Path, ...] = ()
    cell_m: float | None = None
    hidden: tuple[Path, ...] = ()
    confined: bool = True
    compiles_beside: bool = False
    loaded: Policies | None = field(default=None, repr=False)


def is_registered(task: str) -> bool:
    """Whether a name is that of a task rather than an environment's id."""
    name, colon, variant = task.partition(":")
    if name in REGISTERED:
        return bool(variant) if colon else name == DEFAULT_TASK
    return not colon and _world(name) is not None


def register(folder: Path) -> str:
    """Register a folder's world for this process and its children; return its name.

    ValueError if it holds none, or its name is taken.
    """
    folder = folder.resolve()
    if absent := [name for name in ("environment.py", "task.py") if not (folder / name).is_file()]:
        raise ValueError(
            f"expected a world's environment.py and task.py in {folder}, got no {absent[0]}"
        )
    if not re.fullmatch(r"[a-z][a-z0-9_]*", folder.name):
        raise ValueError(f"a world is called by small letters, digits and _, got {folder.name!r}")
    others = [other for other in _folders() if other != folder]
    if folder.name in {*REGISTERED, *(other.name for other in others)}:
        raise ValueError(f"the name {folder.name!r} is taken: give {folder} another one")
    os.environ[WORLDS] = os.pathsep.join(map(str, (*others, folder)))
    return folder.name


def static_of(task: str) -> Path | None:
    """The folder of what draws a task, if its package has one of its own."""
    spec = find_spec(registration_of(task).package)
    places = spec.submodule_search_locations if spec else None
    folders = [Path(place) / "static" for place in places or ()]
    return next((folder for folder in folders if folder.is_dir()), None)


def _folders() -> list[Path]:
    return [Path(folder) for folder in os.environ.get(WORLDS, "").split(os.pathsep) if folder]


def _world(name: str) -> Registration | None:
    """The registration of a world by its folder or its entry point."""
    for folder in _folders():
        if folder.name == name:
            if str(folder.parent) not in sys.path:
                sys.path.append(str(folder.parent))
            return Registration(name)
    for entry in entry_points(group="humanplay.tasks", name=name):
        if not entry.attr:  # else it describes an environment of Gymnasium
            return Registration(entry.module)
    return None


@lru_cache(maxsize=64)
def environment_of(task: str) -> Environment:
    """The environment of a task's name, like `mars` or `gymnasium:FrozenLake-v1`.

    Raises:
        ValueError: If there is none.
    """
    module, variant = _module(task, "environment")
    return cast("Environment", module.environment(variant))


def serve(task: str, start: Start) -> Task:
    """A task as a server offers it.

    Raises:
        ValueError, LookupError, OSError: If the task, or a file of it, cannot be used.
    """
    module, variant = _module(task, "task")
    return cast("Task", module.serve(variant, start))


def registration_of(task: str) -> Registration:
    """The registration of a task by its name; ValueError if there is none."""
    name = task.partition(":")[0]
    registration = REGISTERED.get(name) or _world(name)
    if registration is None:
        raise ValueError(f"expected a task of {', '.join(REGISTERED)}, got {task!r}")
    return registration


def _module(task: str, name: str) -> tuple[ModuleType, str]:
    return import_module(f"{registration_of(task).package}.{name}"), task.partition(":")[2]
