"""The tasks that are registered by name, and the one that is played where none is named."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from humanplay.task import Policies, Rules, Task

DEFAULT_TASK = "mars"
"""What is played where no task is named."""


@dataclass(frozen=True)
class Registration:
    """A task, or a family of tasks whose names begin alike.

    package  has a module `rules` with a function `rules(variant)`, and a module `task` with `serve(variant, start)`
    extras   of the package humanplay that must be installed to play it; the last one includes the others
    """

    package: str
    extras: tuple[str, ...] = ()


REGISTERED = {
    DEFAULT_TASK: Registration("humanplay.tasks.mars", ("mars", "play")),
    "gymnasium": Registration("humanplay.tasks.gymnasium"),
}
"""By the part of a task's name before its colon; what follows it is the variant."""


@dataclass(frozen=True)
class Start:
    """What a server gives the task that it offers.

    policies          files of further policies, or functions
    maps              files of instances, where the task takes some; `cell_m` is the side of their cells in metres
    hidden            files and folders that nothing which is played may read
    compiles_beside   whether a process beside this one compiles what is missing, from now until the task is closed
    loaded            what is on offer, where that is loaded already
    """

    policies: tuple[Path, ...] = ()
    maps: tuple[Path, ...] = ()
    cell_m: float | None = None
    hidden: tuple[Path, ...] = ()
    compiles_beside: bool = False
    loaded: Policies | None = field(default=None, repr=False)


def is_registered(task: str) -> bool:
    """Whether a name is that of a task rather than an environment's id."""
    name, colon, variant = task.partition(":")
    return name in REGISTERED and (bool(variant) if colon else name == DEFAULT_TASK)


@lru_cache(maxsize=64)
def rules_of(task: str) -> Rules:
    """The rules of a task by its name, like `mars` or `gymnasium:FrozenLake-v1`; ValueError if there is none."""
    module, variant = _module(task, "rules")
    return cast("Rules", module.rules(variant))


def serve(task: str, start: Start) -> Task:
    """A task as a server offers it; ValueError, LookupError or OSError if it, or a file of it, is none."""
    module, variant = _module(task, "task")
    return cast("Task", module.serve(variant, start))


def registration_of(task: str) -> Registration:
    """The registration of a task by its name; ValueError if there is none."""
    name = task.partition(":")[0]
    if name not in REGISTERED:
        raise ValueError(f"expected a task of {', '.join(REGISTERED)}, got {task!r}")
    return REGISTERED[name]


def _module(task: str, name: str) -> tuple[ModuleType, str]:
    return import_module(f"{registration_of(task).package}.{name}"), task.partition(":")[2]
