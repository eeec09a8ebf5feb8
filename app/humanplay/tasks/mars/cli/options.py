"""The options --level, --size and --seed, and the configurations they make."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec

import click
from click import UsageError, option

from humanplay.command.options import SizeType

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig

P = ParamSpec("P")


def levels_option(*default: str) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return the option --level, which a command gets as `levels`, a tuple of names."""
    text = "random, t-m-b from 1-1-1 to 3-2-2, building, cave, or all, which leaves these two out; repeatable."
    return option("--level", "levels", multiple=True, default=default, help=text)


def sizes_option(*default: str) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return the option --size: `sizes`, a tuple of sides and of (rows, cols)."""
    text = "21 for a square, 42x84 for rows x columns; repeatable."
    return option("--size", "sizes", type=SizeType(), multiple=True, default=default, help=text)


def seed_option(meaning: str) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return the option --seed of a run, 0..1000; `meaning` says what it fixes."""
    return option("--seed", type=click.IntRange(0, 1000), default=0, help=meaning)


def env_config_of(level: str, size: int | tuple[int, int]) -> EnvConfig:
    """Return the configuration of a level and size; UsageError if there is none."""
    from marsexplorer.config import EnvConfig

    try:
        return EnvConfig.of(level, size)
    except ValueError as error:
        raise UsageError(str(error)) from error
