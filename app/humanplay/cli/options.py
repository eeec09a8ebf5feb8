"""The options that several commands have, and short forms of others: flags, paths, what may be repeated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click import UsageError, option

from humanplay.cli.console import place

if TYPE_CHECKING:
    from humanplay.series.folder import Folder

F = TypeVar("F", bound=Callable[..., Any])
PATH = click.Path(path_type=Path)
COUNT = click.IntRange(min=1)
PORT = click.IntRange(0, 65535)
KEY = option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed it.")
WORKERS = option("--workers", type=COUNT, help="Processes that play.  [default: one for each core]")


def flag(*given: str, default: bool | None = False) -> Callable[[F], F]:
    """Return an option without a value: its names, then what it does."""
    return option(*given[:-1], is_flag=True, default=default, help=given[-1])


def path_option(*given: str, **more: Any) -> Callable[[F], F]:
    """Return an option that takes a path: its names, then what it is for."""
    return option(*given[:-1], type=PATH, help=given[-1], **more)


def several(*given: str, **more: Any) -> Callable[[F], F]:
    """Return an option that may be repeated: its names, then what it is for."""
    return option(*given[:-1], multiple=True, help=given[-1], **more)


class SizeType(click.ParamType):  # type: ignore[type-arg]
    """`21` for a square, `42x84` for rows x columns."""

    name = "size"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | tuple[int, int]:
        """Return a side or (rows, cols)."""
        if isinstance(value, (int, tuple)):
            return value
        parts = str(value).lower().split("x")
        if not 1 <= len(parts) <= 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected a side like 21 or ROWSxCOLS like 42x84, got {value!r}", param, ctx)
        return (int(parts[0]), int(parts[1])) if len(parts) == 2 else int(parts[0])


def levels_option(*default: str) -> Callable[[F], F]:
    """Return the option --level, which the command is given as `levels`, a tuple of names."""
    text = "random, t-m-b from 1-1-1 to 3-2-2, or all; repeatable."
    return option("--level", "levels", multiple=True, default=default, help=text)


def sizes_option(*default: str) -> Callable[[F], F]:
    """Return the option --size, which the command is given as `sizes`, a tuple of sides and of (rows, cols)."""
    text = "21 for a square, 42x84 for rows x columns; repeatable."
    return option("--size", "sizes", type=SizeType(), multiple=True, default=default, help=text)


def seed_option(what: str) -> Callable[[F], F]:
    """Return the option --seed of a run, 0..1000; `what` says what it fixes."""
    return option("--seed", type=click.IntRange(0, 1000), default=0, help=what)


def check_more(more: Sequence[object], policies: Sequence[object]) -> None:
    """Raise UsageError for words without an option, unless they follow --policy NAME as in `--policy a b c`."""
    if more and not policies:
        raise UsageError(f"unexpected argument {str(more[0])!r}: name policies with --policy")


def _database(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path:
    return path or place().database


def _studies(ctx: click.Context, param: click.Parameter, path: Path | None) -> Folder:
    from humanplay.series.folder import Folder

    return Folder.beside(_database(ctx, param, path))


def _database_with_studies(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path:
    ctx.params["folder"] = _studies(ctx, param, path)
    return _database(ctx, param, path)


def database_option(text: str) -> Callable[[F], F]:
    """Return the option --database, which is that of the settings where it is not given; `text` says what it is for."""
    return option("--database", type=PATH, callback=_database, help=text)


DATABASE = database_option("The database it was played in; a running server may go on writing.")
STUDIES = option(
    "--database", "folder", type=PATH, callback=_studies, help="The database whose study it is."
)
"""The option --database of a command that is given the folder of studies beside it, as `folder`."""
DATABASE_AND_STUDIES = option(
    "--database",
    type=PATH,
    callback=_database_with_studies,
    help="The database it is played in; a running server may go on writing.",
)
"""The option --database of a command that is given `database`, and the folder beside it as `folder`."""
