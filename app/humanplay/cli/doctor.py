"""`humanplay doctor`: does an environment follow from its seed and its actions?"""

from __future__ import annotations

import json
from collections.abc import Mapping

import click
from click import BadParameter, UsageError, argument, echo, option

from humanplay.cli.settings import task_name
from humanplay.command.console import progress
from humanplay.command.options import flag
from humanplay.task import counted


def _print_schema(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from humanplay.tasks.gymnasium.description import Description

        echo(json.dumps(Description.model_json_schema(), indent=2))
        context.exit()


COLUMNS = (
    "environment", "follows from seed and actions", "ms a step", "ms a picture", "picture", "keys", "people see", "agents see",
)  # fmt: skip
WORTH_SAYING_S = 60.0
"""Seconds from which an examination's time is said before it begins."""
MOST_KEYS = 9
"""Actions whose keys a row of the table names; of more only how many there are."""


def _row(env: str, seeds: int, steps: int, rule: str | None) -> int:
    """Print an environment's row of the table and return its exit code."""
    from humanplay.task.registration import environment_of
    from humanplay.tasks.gymnasium.doctor import examine
    from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment

    shown = env
    try:
        environment = environment_of(task_name(env))
        if not isinstance(environment, GymnasiumEnvironment):
            title = environment.about.title
            raise ValueError(f"expected an id of Gymnasium's; {title} follows from seed and moves")
        described = environment.description
        shown = " in ".join(
            (environment.level, *(name.partition(":")[2] for name in described.wrappers))
        )
        with progress(shown) as advance:
            examination = examine(environment.name, seeds, steps, advance, rule=rule)
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
@option("--rule", metavar="MODULE:FUNCTION", help="Chooses every third seed's actions.")
@flag("--json", "as_json", "Print everything as JSON.")
@flag("--table", "Print a row of Markdown for each of several ENV.")
@flag("--toml", "Play nothing; print what is known of ENV as a file to edit.")
@option(
    "--schema", is_flag=True, is_eager=True, expose_value=False, callback=_print_schema,
    help="Print the JSON schema of that file.",
)  # fmt: skip
def doctor(
    envs: tuple[str, ...],
    seeds: int,
    steps: int,
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
        return max([_row(env, seeds, steps, rule) for env in envs])
    if len(envs) > 1:
        raise UsageError(f"expected one ENV, got {len(envs)}; --table takes several")
    task = task_name(envs[0])
    if not task.startswith("gymnasium:"):
        raise UsageError(f"expected an id of Gymnasium's; {task} follows from seed and moves")
    try:
        if toml:
            echo(_description_file(task), nl=False)
            return 0
        with progress("playing in fresh processes") as advance:
            examination = examine(task, seeds, steps, advance, rule=rule, estimated=_echo_estimate)
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


def _echo_estimate(seconds: float) -> None:
    """Say how long it will take, if that is worth saying."""
    if seconds > WORTH_SAYING_S:
        echo(
            f"this takes about {counted(round(seconds / 60), 'minute')}; fewer --steps take less",
            err=True,
        )


def _description_file(task: str) -> str:
    """All that is known of an environment as a TOML file.

    What the description leaves open is derived.

    Raises:
        ValueError: If there is no such environment.
    """
    from humanplay.tasks.gymnasium.description import Description
    from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment

    environment = GymnasiumEnvironment(task.partition(":")[2])
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
        lines.append(f"{line}  # {field.description}\n")
    return "".join(lines)


def _toml(content: object) -> str:
    """Content as TOML: JSON but for tables."""
    if isinstance(content, Mapping):
        fields = ", ".join(f"{json.dumps(name)} = {_toml(part)}" for name, part in content.items())
        return f"{{ {fields} }}"
    if isinstance(content, list | tuple):
        return f"[{', '.join(map(_toml, content))}]"
    return json.dumps(content, ensure_ascii=False)
