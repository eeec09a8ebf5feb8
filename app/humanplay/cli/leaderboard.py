"""The command `humanplay leaderboard`: the results of the shipped policies."""

from __future__ import annotations

from pathlib import Path

import click
from click import UsageError, echo, option

from humanplay.cli.settings import task_name
from humanplay.command.console import progress, write_file, written
from humanplay.command.options import COUNT, path_option, several


@click.command(short_help="Make the leaderboard's figures of the shipped policies.")
@option("--env", metavar="ENV", help="Another environment, as for serve.  [default: MarsExplorer]")
@several("--board", "boards", "A board such as random-21x21; repeatable.  [default: all on offer]")
@several("--policy", "again", "Play this one alone, and keep the others' figures; repeatable.")
@path_option("--out", "Folder for the figures, a file a board; made when absent.", required=True)
@option("--workers", type=COUNT, default=1, help="Processes that play at the same time.")
def leaderboard(
    env: str | None, boards: tuple[str, ...], again: tuple[str, ...], out: Path, workers: int
) -> None:
    """Play the leaderboard's terrains with the shipped policies and write figures.

    A new server shows them at once. The package comes with the figures that this command wrote to
    data/leaderboard. Run it again when the rules, a shipped policy or the terrains have changed.
    The figures are the same for any number of processes. All boards take about half an hour of one
    core; most of it is `lookahead` on 84 x 84 cells. With --policy the figures that --out has of
    other policies stay, where they still hold.

    \b
    Examples:
      humanplay leaderboard --out data/leaderboard
      humanplay leaderboard --board random-21x21 --board 1-1-1-21x21 --out figures --workers 2
      humanplay leaderboard --policy ppo --out data/leaderboard
      humanplay leaderboard --env examples/worlds/maze --out figures
    """
    from humanplay.jobs import Jobs
    from humanplay.results.entries import make_board, offered_boards
    from humanplay.results.evaluations import ShippedFigures, file_name
    from humanplay.task.registration import DEFAULT_TASK, environment_of

    task = DEFAULT_TASK if env is None else task_name(env)
    environment = environment_of(task)
    if environment.boards is None:
        raise UsageError(f"{environment.about.title} has no leaderboard")
    offered = offered_boards(task)
    if unknown := [name for name in boards if name not in offered]:
        raise UsageError(f"no board {unknown[0]!r}; choose one of: {', '.join(offered)}")
    names = [offer.name for offer in environment.policies.offers()]
    if unknown := [name for name in again if name not in names]:
        raise UsageError(f"no policy {unknown[0]!r} is shipped; there are {', '.join(names)}")
    shipped = ShippedFigures(out) if again else None
    for name in boards or offered:
        path = out / file_name(offered[name].config, task)
        with Jobs(workers) as jobs, progress(f"playing {name}") as advance:
            text = make_board(offered[name], jobs, advance, shipped, again)
        with written(path):
            out.mkdir(parents=True, exist_ok=True)
        write_file(path, text.encode(), "--out")
        echo(path)
