"""Numbers as reports and commands print them.

They have a real minus sign, "low to high", and a dash for no number. `templates` is what their
documents are written with.
"""

from __future__ import annotations

import time
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from humanplay.report.statistics.intervals import Interval
from humanplay.task import counted as counted

NONE = "–"


def number(value: float | None, digits: int) -> str:
    """A number with so many decimals, a dash for None and NaN, ∞ for an infinite one."""
    if value is None or value != value:
        return NONE
    return f"{value:.{digits}f}".replace("-", "−").replace("inf", "∞")


def interval(ends: Interval | None, digits: int) -> str:
    """ "low to high" with so many decimals; a dash for None."""
    return NONE if ends is None else f"{number(ends[0], digits)} to {number(ends[1], digits)}"


def p_value(p: float | None) -> str:
    """p with three decimals, "< 0.001" below that, a dash for None."""
    return NONE if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"


def percent(share: float, digits: int = 0) -> str:
    """A share of 0..1 in percent, as in "46 %"."""
    return f"{100 * share:.{digits}f} %"


def utc(ms: int) -> str:
    """Milliseconds since 1970 as a time in UTC, as in "2026-01-31T08:05:00Z"."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(ms / 1000))


def templates(folder: Path, is_html: bool) -> Environment:
    """The templates of a folder; a name without a definition is an error.

    Args:
        is_html: Whether to escape what HTML does not let through.
    """
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=is_html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["counted"] = counted
    return environment
