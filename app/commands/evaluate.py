"""The command `marsexplorer evaluate`: policies on the same terrains, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.console import PATH, Size, check_more, config_of, interruptible, print_table, progress, reason

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluate import Table


@click.command(short_help="Score policies on the same terrains.")
@click.option("--policy", "policies", multiple=True, required=True, help="A policy's name or file; repeatable.")
@click.option("--level", default="random", show_default=True, help="random, or t-m-b from 1-1-1 to 3-2-2.")
@click.option("--size", type=Size(), default="21", show_default=True, help="21 for a square, 42x84 for rows x columns.")
@click.option(
    "--episodes", type=click.IntRange(min=2), default=100, show_default=True, help="Terrains to play, the same for all."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The first terrain's seed.")
@click.option("--json", "json_path", type=PATH, help="Also write the table to this file.")
@click.argument("more", nargs=-1, metavar="")
def evaluate(
    policies: tuple[str, ...],
    more: tuple[str, ...],
    level: str,
    size: int | tuple[int, int],
    episodes: int,
    seed: int,
    json_path: Path | None,
) -> None:
    """Play policies on the same terrains and print score, completion and steps to 99 %.

    The score hardly tells good policies apart (ten steps are worth 0.004): read steps to 99 % beside it.

    \b
    Examples:
      marsexplorer evaluate --policy random --policy frontier-utility
      marsexplorer evaluate --policy mine.safetensors --level 2-1-1 --size 42x84 --episodes 50 --json result.json
    """
    check_more(more, policies)
    config = config_of(level, size)
    if json_path is None:
        _show(_evaluated((*policies, *more), config, episodes, seed))
        return
    from app.export import whole_file

    try:
        with whole_file(json_path) as file:
            table = _evaluated((*policies, *more), config, episodes, seed)
            file.write(table.to_json().encode() + b"\n")
    except OSError as error:
        raise click.ClickException(f"cannot write {json_path}: {reason(error)}; choose another --json") from error
    _show(table)


def _evaluated(names: Sequence[str], config: EnvConfig, episodes: int, seed: int) -> Table:
    from marsexplorer.evaluate import evaluate as measure
    from marsexplorer.policies import PolicyFileError, PolicyNotFound

    with progress("playing (the rules are compiled first)") as advance:
        try:
            return interruptible(lambda: measure(names, config, episodes, seed, advance))
        except (PolicyNotFound, PolicyFileError, ValueError) as error:
            raise click.UsageError(str(error)) from error
        except OSError as error:
            raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error


def _show(table: Table) -> None:
    rows = []
    for row in table.rows:
        interval = f"{row.score_low:.4f} .. {row.score_high:.4f}"
        values = (str(row.episodes), f"{row.score_mean:.4f}", interval, f"{row.completion:.1%}", f"{row.steps_mean:.1f}")
        rows.append((row.policy, *values))
    columns = ("policy", "episodes", "mean score", "95 % interval", "completion", "steps to 99 %")
    print_table("The same terrains for every policy; score with its 95 % interval", columns, rows)
