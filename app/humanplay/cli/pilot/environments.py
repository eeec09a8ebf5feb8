"""The name of what is played; without one, a function that the program holds."""

from __future__ import annotations

from pathlib import Path

import gymnasium

from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.names import importable_name
from humanplay.cli.pilot.recreation import recreated
from humanplay.cli.settings import named_task
from humanplay.jobs import held
from humanplay.tasks.gymnasium.kinds import refusal_of

EXPECTED = (
    "expected an environment of Gymnasium, a class or function that makes one, an id, or a file"
)


def task_of(env: object) -> str:
    """Name the task that plays an environment.

    Args:
        env: An environment, a class or function that makes one, an id, a file's path, or the folder of a world.

    Raises:
        PilotError: It is none of these.
    """
    if reason := refusal_of(env if isinstance(env, type) else type(env)):
        raise PilotError(reason)
    name = (
        str(env) if isinstance(env, str | Path) else importable_name(env) if callable(env) else ""
    )
    if name:
        try:
            return named_task(name)
        except ValueError as error:
            raise PilotError(str(error)) from error
    if isinstance(env, gymnasium.Env):
        return f"gymnasium:{recreated(env)}"
    if callable(env):
        return f"gymnasium:{held.SCHEME}:{held.hold(env)}"
    raise PilotError(f"{EXPECTED}; got {type(env).__name__}")
