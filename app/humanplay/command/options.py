"""The options that several commands have, and short forms of others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from click import UsageError, option

F = TypeVar("F", bound=Callable[..., Any])
PATH = click.Path(path_type=Path)
COUNT = click.IntRange(min=1)
PORT = click.IntRange(0, 65535)
KEY = option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed it.")


def flag(*texts: str, default: bool | None = False) -> Callable[[F], F]:
    """An option without a value: its names, then what it does."""
    return option(*texts[:-1], is_flag=True, default=default, help=texts[-1])


def path_option(*texts: str, **more: Any) -> Callable[[F], F]:
    """An option that takes a path: its names, then what it is for."""
    return option(*texts[:-1], type=PATH, help=texts[-1], **more)


def several(*texts: str, **more: Any) -> Callable[[F], F]:
    """An option that may be repeated: its names, then what it is for."""
    return option(*texts[:-1], multiple=True, help=texts[-1], **more)


class SizeType(click.ParamType):  # type: ignore[type-arg]
    """`21` for a square, `42x84` for rows x columns."""

    name = "size"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | tuple[int, int]:
        """A side or (rows, cols)."""
        if isinstance(value, int):
            return value
        if isinstance(value, tuple):
            rows, cols = value
            return rows, cols
        parts = str(value).lower().split("x")
        if not 1 <= len(parts) <= 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected a side like 21 or ROWSxCOLS like 42x84, got {value!r}", param, ctx)
        return (int(parts[0]), int(parts[1])) if len(parts) == 2 else int(parts[0])


def check_more(more: Sequence[object], policies: Sequence[object]) -> None:
    """Raise UsageError for words without an option.

    Unless they follow --policy NAME, as in `--policy a b c`.
    """
    if more and not policies:
        raise UsageError(f"unexpected argument {str(more[0])!r}: name policies with --policy")
