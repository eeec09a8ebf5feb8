"""The command `marsexplorer`: serve the playground, export what was played, evaluate and train policies.

Whatever goes wrong ends in one sentence on stderr: exit code 2 for a command that cannot be carried out as given, 1 for a
failure on the way, 130 for Ctrl-C. Heavy modules are imported inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from app.train import train

if TYPE_CHECKING:
    from rich.progress import Progress

    from app.export import Format
    from app.reader import Who
    from app.settings import Settings
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluate import Table

T = TypeVar("T")
PATH = click.Path(path_type=Path)
PRINTED_WIDTH = 120
"""Characters of a table that goes to a file or a pipe."""


class Size(click.ParamType):  # type: ignore[type-arg]
    """`21` for a square, `42x84` for rows x columns."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | tuple[int, int]:
        """Return a side or (rows, cols)."""
        if isinstance(value, (int, tuple)):
            return value
        parts = str(value).lower().split("x")
        if not 1 <= len(parts) <= 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected a side like 21 or ROWSxCOLS like 42x84, got {value!r}", param, ctx)
        return (int(parts[0]), int(parts[1])) if len(parts) == 2 else int(parts[0])


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="marsexplorer-playground", prog_name="marsexplorer")
def cli() -> None:
    """Drive the MarsExplorer rover in a browser, beside a policy; keep every episode; compare.

    \b
    Begin with:
      marsexplorer serve                                    play at http://127.0.0.1:8000
      marsexplorer export --format csv --out results        what was played, as tables
      marsexplorer evaluate --policy frontier-cost          a policy's score, with its interval
      marsexplorer train --out mine.safetensors             a policy of your own
    Each command explains itself: marsexplorer serve --help
    """


cli.add_command(train)


@cli.command(short_help="Play and watch in a browser; record every move.")
@click.option("--host", help="Address to listen on; 0.0.0.0 lets other machines in.  [default: 127.0.0.1]")
@click.option("--port", type=click.IntRange(0, 65535), help="Port to listen on; 0 takes a free one.  [default: 8000]")
@click.option("--database", type=PATH, help="SQLite file to record in; made when absent.  [default: see below]")
@click.option("--policy", "policies", type=PATH, multiple=True, help="A trained policy's file to offer; repeatable.")
@click.option("--durable", is_flag=True, default=None, help="Survive a power cut, at some milliseconds a move.")
@click.argument("more", type=PATH, nargs=-1, metavar="")
def serve(more: tuple[Path, ...], policies: tuple[Path, ...], **given: Any) -> None:
    """Serve the playground until Ctrl-C: page, API and 3-D view on one port.

    Every move is in the database before its frame is sent: killing the server loses nothing, and the next start
    goes on with the unfinished episodes. Without --database it is data/playground.db in a checkout,
    ./playground.db elsewhere. MARS_HOST, MARS_PORT, MARS_DATABASE and MARS_DURABLE stand in for absent flags.

    \b
    Examples:
      marsexplorer serve
      marsexplorer serve --port 9000 --database lab.db
      marsexplorer serve --host 0.0.0.0 --policy mine.safetensors
    """
    _check_more(more, policies)
    flags = {name: value for name, value in given.items() if value is not None}
    if policies or more:
        flags["policies"] = (*policies, *more)
    settings = _settings(**flags)
    from app.server import ServerError, run
    from app.store import StoreError

    try:
        run(settings)
    except (ServerError, StoreError) as error:
        raise click.ClickException(str(error)) from error


@cli.command(short_help="Write what was played as CSV or JSON Lines.")
@click.option("--database", type=PATH, help="The database to read; a running server may go on writing.")
@click.option(
    "--format", "fmt", type=click.Choice(["csv", "jsonl"]), default="csv", show_default=True, help="CSV or JSON Lines."
)
@click.option("--out", type=PATH, required=True, help="Folder for episodes.* and steps.*; made when absent.")
@click.option("--who", type=click.Choice(["all", "human"]), default="all", show_default=True, help="human: the counted ones.")
def export(database: Path | None, fmt: Format, out: Path, who: Who) -> None:
    """Write every finished episode, and every step of it, as two tables.

    Each episode is replayed on its way out; `verified` is false where the replay differs from what was recorded.
    Players appear under pseudonyms drawn anew for each export. docs/data.md lists the columns. Both files appear
    whole or not at all.

    \b
    Examples:
      marsexplorer export --out results
      marsexplorer export --database lab.db --format jsonl --out results --who human
    """
    from app.export import export_to
    from app.store import StoreError

    path = database or _settings().database
    try:
        with _progress("exporting") as advance:
            summary = export_to(path, out, fmt, who, advance)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot write to {out}: {_reason(error)}; choose another --out") from error
    click.echo(summary)


@cli.command(short_help="Score policies on the same terrains.")
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
    _check_more(more, policies)
    config = _config(level, size)
    if json_path is None:
        _show(_evaluated((*policies, *more), config, episodes, seed))
        return
    from app.export import whole_file

    try:
        with whole_file(json_path) as file:
            table = _evaluated((*policies, *more), config, episodes, seed)
            file.write(table.to_json().encode() + b"\n")
    except OSError as error:
        raise click.ClickException(f"cannot write {json_path}: {_reason(error)}; choose another --json") from error
    _show(table)


def _evaluated(names: Sequence[str], config: EnvConfig, episodes: int, seed: int) -> Table:
    from marsexplorer.evaluate import evaluate as measure
    from marsexplorer.policies import PolicyFileError, PolicyNotFound

    with _progress("playing (the rules are compiled first)") as advance:
        try:
            return _interruptible(lambda: measure(names, config, episodes, seed, advance))
        except (PolicyNotFound, PolicyFileError, ValueError) as error:
            raise click.UsageError(str(error)) from error
        except OSError as error:
            raise click.ClickException(f"cannot read {error.filename}: {_reason(error)}") from error


def _show(table: Table) -> None:
    """Print the table; a policy's name is never cut."""
    from rich.console import Console
    from rich.table import Table as Grid

    grid = Grid(title="The same terrains for every policy; score with its 95 % interval")
    grid.add_column("policy", no_wrap=True)
    for name in ("episodes", "mean score", "95 % interval", "completion", "steps to 99 %"):
        grid.add_column(name, justify="right")
    for row in table.rows:
        interval = f"{row.score_low:.4f} .. {row.score_high:.4f}"
        values = (str(row.episodes), f"{row.score_mean:.4f}", interval, f"{row.completion:.1%}", f"{row.steps_mean:.1f}")
        grid.add_row(row.policy, *values)
    console = Console()
    if not console.is_terminal:
        console = Console(width=PRINTED_WIDTH)
    console.print(grid)


def _check_more(more: Sequence[object], policies: Sequence[object]) -> None:
    """Return when words without an option follow --policy NAME, as in `--policy a b c`; UsageError otherwise."""
    if more and not policies:
        raise click.UsageError(f"unexpected argument {str(more[0])!r}: name policies with --policy")


def _settings(**flags: Any) -> Settings:
    from pydantic import ValidationError

    from app.settings import Settings

    try:
        return Settings(**flags)
    except ValidationError as error:
        first = error.errors()[0]
        name = "_".join(str(part) for part in first["loc"])
        raise click.UsageError(f"setting {name}: {first['msg'].lower()}, got {first['input']!r}") from error


def _config(level: str, size: int | tuple[int, int]) -> EnvConfig:
    from marsexplorer.config import EnvConfig

    try:
        return EnvConfig.of(level, size)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _interruptible(work: Callable[[], T]) -> T:
    """Return what `work()` gives; Ctrl-C ends it and the processes it started at once.

    It is done in a thread that Ctrl-C does not reach. Its processes inherit that, else each would print a traceback of
    its own; they are killed instead of playing their episodes to the end.
    """
    done: Future[T] = Future()

    def body() -> None:
        resource_tracker.ensure_running()  # its start, at the first process, would undo the next line
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            done.set_result(work())
        except BaseException as error:
            done.set_exception(error)

    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    try:
        return done.result()
    except KeyboardInterrupt:
        while workers := multiprocessing.active_children():
            for worker in workers:
                worker.kill()
            thread.join(0.1)
        raise


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Return `advance(done, total)` moving a bar on stderr; nothing is drawn where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar: Progress
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave with its exit code."""
    try:
        code = cli.main(args, prog_name="marsexplorer", standalone_mode=False)
    except click.UsageError as error:
        hint = f" (see {error.ctx.command_path} --help)" if error.ctx else ""
        click.echo(f"marsexplorer: {error.format_message()}{hint}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        click.echo(f"marsexplorer: {error.format_message()}", err=True)
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
