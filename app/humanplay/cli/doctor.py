"""`humanplay doctor`: does an environment follow from its seed and its actions?"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import click
from click import BadParameter, UsageError, argument, echo, option

from humanplay.cli.settings import task_name
from humanplay.command.console import progress
from humanplay.command.options import flag
from humanplay.task import counted

if TYPE_CHECKING:
    from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment


def _print_schema(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from humanplay.tasks.gymnasium.description import Description

        echo(json.dumps(Description.model_json_schema(), indent=2))
        context.exit()


COLUMNS = (
    "environment", "follows from seed and actions", "ms a step", "ms a picture", "picture", "keys", "people see", "agents see",
)  # fmt: skip
MOST_KEYS = 9
"""Actions whose keys a row of the table names; of more only how many there are."""


def _environment_of(env: str) -> GymnasiumEnvironment:
    """The environment of Gymnasium that is named; ValueError for any other."""
    from humanplay.task.registration import environment_of
    from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment

    environment = environment_of(task_name(env))
    if not isinstance(environment, GymnasiumEnvironment):
        raise ValueError(
            f"expected an environment of Gymnasium's; {environment.about.title} is a world of its "
            "own, whose episodes `humanplay verify` plays again"
        )
    return environment


def _row(env: str, seeds: int, steps: int, rule: str | None, minutes: float) -> int:
    """Print an environment's row of the table and return its exit code."""
    from humanplay.tasks.gymnasium.doctor import examine

    shown = env
    try:
        environment = _environment_of(env)
        described = environment.description
        shown = " in ".join(
            (environment.level, *(name.partition(":")[2] for name in described.wrappers))
        )
        with progress(shown) as advance:
            examination = examine(
                environment.name, seeds, steps, advance, rule=rule, limit_s=60 * minutes,
                shortened=_echo_shortened,
            )  # fmt: skip
    except (BadParameter, ValueError) as error:
        reason = " ".join(str(error).replace("|", "/").split())
        echo(f"| {shown} | cannot be played: {reason} |{' |' * (len(COLUMNS) - 2)}")
        return 2
    verdict = f"no difference in {counted(examination.steps, 'move')}"
    if examination.differences:
        verdict = str(examination.differences[0])
    if examination.used:
        verdict += "; a used one after reset differs, which does not count"
    keys = [f"{codes[0]} {name}" for name, codes in examination.keys.items() if codes]
    (rows, columns), size = examination.picture, examination.picture_bytes
    cells = (
        shown, verdict, f"{examination.step_ms:.3g}", f"{examination.picture_ms:.3g}",
        f"{rows}x{columns}, {size:,} bytes" if size else f"{rows}x{columns} characters",
        ", ".join(keys) if len(keys) <= MOST_KEYS else f"{len(keys)} keys",
        described.people_see or ("its picture" if size else "its text"), described.agents_see or "not said",
    )  # fmt: skip
    echo(f"| {' | '.join(cells)} |")
    return int(bool(examination.differences))


@click.command(short_help="Say whether an environment follows from seed and actions.")
@argument("envs", nargs=-1, required=True, metavar="ENV...")
@option("--seeds", type=click.IntRange(1, 100), default=5, help="How many seeds.")
@option(
    "--steps", type=click.IntRange(1, 1_000_000), default=2000,
    help="Moves for each seed; where an episode ends, another begins.",
)  # fmt: skip
@option(
    "--minutes", type=click.FloatRange(0.1, 1440), default=2.0, show_default=True,
    help="About how long it may take: beyond it, fewer moves are played.",
)  # fmt: skip
@option("--rule", metavar="MODULE:FUNCTION", help="Chooses every third seed's actions.")
@flag("--json", "as_json", "Print everything as JSON.")
@flag("--table", "Print a row of Markdown for each of several ENV.")
@flag("--toml", "Print what is known and proposed of ENV as a file to edit.")
@option(
    "--schema", is_flag=True, is_eager=True, expose_value=False, callback=_print_schema,
    help="Print the JSON schema of that file.",
)  # fmt: skip
def doctor(
    envs: tuple[str, ...],
    seeds: int,
    steps: int,
    minutes: float,
    rule: str | None,
    as_json: bool,
    table: bool,
    toml: bool,
) -> int:
    """Play ENV in fresh processes, and compare its episodes step by step.

    ENV is whatever `humanplay play` takes. Its episodes are played again with four other hash
    seeds, in another folder and time zone, after other episodes, without rendering and in a used
    environment. Exit code 0 says that no difference was found, 1 that there was one, 2 that ENV
    cannot be played.

    \b
    Examples:
      humanplay doctor FrozenLake-v1
      humanplay doctor minigrid:MiniGrid-FourRooms-v0 --steps 500
      humanplay doctor rooms.toml --json
      humanplay doctor minigrid:MiniGrid-FourRooms-v0 --toml > rooms.toml
      humanplay doctor --table CartPole-v1 Acrobot-v1 rooms.toml
    """
    from humanplay.tasks.gymnasium.doctor import examine

    if table:
        echo(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
        return max([_row(env, seeds, steps, rule, minutes) for env in envs])
    if len(envs) > 1:
        raise UsageError(f"expected one ENV, got {len(envs)}; --table takes several")
    try:
        environment = _environment_of(envs[0])
        if toml:
            echo(_description_file(environment), nl=False)
            return 0
        with progress("playing in fresh processes") as advance:
            examination = examine(
                environment.name, seeds, steps, advance, rule=rule, limit_s=60 * minutes,
                shortened=_echo_shortened,
            )  # fmt: skip
    except ValueError as error:
        raise UsageError(str(error)) from error
    if as_json:
        echo(json.dumps(examination.to_dict(), indent=2))
        return int(bool(examination.differences))
    echo(examination.verdict)
    for difference in examination.differences[1:]:
        echo(f"also: {difference}")
    if examination.used:
        echo(f"no fault here, where each episode has a fresh environment: {examination.used}")
    rows, columns = examination.picture
    size = (
        f"pixels, {examination.picture_bytes} bytes as PNG"
        if examination.picture_bytes
        else "characters"
    )
    echo(
        f"a step takes {examination.step_ms:.3g} ms of processor, "
        f"a picture of {columns} x {rows} {size} {examination.picture_ms:.3g} ms"
    )
    for action, keys in examination.keys.items():
        echo(f"  {action}: {', '.join(keys) or 'no key'}")
    return int(bool(examination.differences))


def _echo_shortened(seconds: float, steps: int) -> None:
    """Say how long the whole would take, and what is played instead."""
    minutes = math.ceil(seconds / 60)
    echo(
        f"this would take up to {counted(minutes, 'minute')}: {counted(steps, 'move')} for each "
        f"seed are played; --minutes {minutes} plays all",
        err=True,
    )


def _description_file(environment: GymnasiumEnvironment) -> str:
    """All that is known of an environment as a TOML file.

    What the description leaves open is derived, or proposed.
    """
    from humanplay.tasks.gymnasium.description import Description
    from humanplay.tasks.gymnasium.doctor import proposals
    from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment

    description = environment.description
    if proposed := proposals(environment.name):
        description = Description.model_validate(
            description.model_dump(exclude_unset=True) | proposed
        )
        environment = GymnasiumEnvironment(description.told)
    fields = environment.description.model_dump(mode="json") | {
        "title": environment.about.title,
        "actions": environment.actions,
        "keys": {code: name for name, codes in environment.keys.items() for code in codes},
        "max_steps": environment.limit,
    }
    lines = []
    for name, field in Description.model_fields.items():
        is_said = fields[name] not in ({}, [None, None])
        line = f"{name} = {_toml(fields[name])}" if is_said else f"# {name} ="
        note = "proposed: " if name in proposed else ""
        lines.append(f"{line}  # {note}{field.description}\n")
    return "".join(lines)


def _toml(content: object) -> str:
    """Content as TOML: JSON but for tables."""
    if isinstance(content, Mapping):
        fields = ", ".join(f"{json.dumps(name)} = {_toml(part)}" for name, part in content.items())
        return f"{{ {fields} }}"
    if isinstance(content, list | tuple):
        return f"[{', '.join(map(_toml, content))}]"
    return json.dumps(content, ensure_ascii=False)
