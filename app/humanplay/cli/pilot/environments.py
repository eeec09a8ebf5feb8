"""What is to be played: by a name wherever there is one, else as a function that the program holds."""

from __future__ import annotations

from pathlib import Path

import gymnasium

from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.names import importable_name
from humanplay.cli.pilot.recreation import recreated
from humanplay.cli.settings import named_task
from humanplay.jobs import held

EXPECTED = (
    "expected an environment of Gymnasium, a class or function that makes one, an id, or a file"
)
MANY = "it steps many environments at once, and a person plays one: play(lambda: gymnasium.make(ID, render_mode='rgb_array'))"
AGENTS = "it has several agents, and Gymnasium's has one: let the others act in a wrapper, and play the class of that"
GYM = (
    "Gym is Gymnasium's predecessor: pip install 'shimmy[gym-v26]', and "
    "play(lambda: gymnasium.make('GymV26Environment-v0', env_id=ID, render_mode='rgb_array'))"
)
REFUSED = {
    "gymnasium.vector": MANY, "gymnasium.experimental.vector": MANY, "stable_baselines3.common.vec_env": MANY,
    "pettingzoo": AGENTS, "gym": GYM,
}  # fmt: skip
"""By the module of one of its classes: why an environment cannot be played, and the way out."""


def task_of(env: object) -> str:
    """Name the task that plays an environment.

    Args:
        env: An environment, a class or function that makes one, an id, a file's path, or the folder of a world.

    Raises:
        PilotError: It is none of these.
    """
    check_kind(env)
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


def check_kind(env: object) -> None:
    """Raise PilotError for an environment of another kind than Gymnasium's."""
    for base in type(env).__mro__ if not isinstance(env, type) else env.__mro__:
        for package, reason in REFUSED.items():
            if base.__module__ == package or base.__module__.startswith(f"{package}."):
                kind = env.__name__ if isinstance(env, type) else type(env).__name__
                raise PilotError(f"{kind} cannot be played: {reason}")
