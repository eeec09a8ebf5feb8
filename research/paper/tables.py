"""Numbers with their 95 % intervals, and tables of them in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isnan, nan

import numpy as np

from marsexplorer.intervals import Floats, t_interval


@dataclass(frozen=True)
class Estimate:
    """A mean, a ratio or a share with its 95 % interval; NaN if unknown."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float] | Floats) -> Estimate:
        """The mean of independent values with its t interval, NaN for fewer than two."""
        array = np.array(values, np.float64)
        if len(array) < 2:
            return cls(float(array[0]) if len(array) else nan, nan, nan)
        return cls(float(array.mean()), *map(float, t_interval(array)))

    @property
    def is_known(self) -> bool:
        """Whether there is a mean."""
        return not isnan(self.mean)

    def text(self, digits: int = 3, unit: str = "") -> str:
        """The mean with half of its interval, such as `0.912 ± 0.020`; "none" if unknown."""
        if not self.is_known:
            return "none"
        half = "" if isnan(self.high) else f" ± {self.high - self.mean:.{digits}f}"
        return f"{self.mean:.{digits}f}{half}{unit}"

    def percent(self, digits: int = 0) -> str:
        """A share in per cent with half of its interval, such as `95 ± 2 %`."""
        return Estimate(100 * self.mean, 100 * self.low, 100 * self.high).text(digits, " %")

    def span(self, form: str) -> str:
        """The mean with its interval, such as `1.02 (1.00 to 1.05)`; "" if unknown."""
        mean, low, high = (form.format(number) for number in (self.mean, self.low, self.high))
        return (mean if low == high else f"{mean} ({low} to {high})") if self.is_known else ""


UNKNOWN = Estimate(nan, nan, nan)


def per_cent(share: float, digits: int = 0) -> str:
    """A share in per cent; only exactly 0 and 1 become 0 and 100."""
    rounded, step = round(100 * share, digits), 10.0**-digits
    if rounded == 100 and share < 1:
        return f">{100 - step:.{digits}f} %"
    return f"<{step:.{digits}f} %" if rounded == 0 and share > 0 else f"{rounded:.{digits}f} %"


def tenths(share: float) -> str:
    """A share in per cent with one digit: that of 200 terrains exactly."""
    return per_cent(share, 1)


def low_to_high(numbers: Sequence[float], text: Callable[[float], str] = "{:.2f}".format) -> str:
    """The smallest and the largest of some numbers in words, their % once."""
    low, high = text(min(numbers)), text(max(numbers))
    return low if low == high else f"{low.removesuffix(' %')} to {high}"


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown, without a line break at its end."""
    first, *others = ("| " + " | ".join(cells) + " |" for cells in (columns, *rows))
    return "\n".join([first, "|---" * len(columns) + "|", *others])


def without_constants(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table without its constant columns, which a line above it has."""
    if not rows:  # no column of theirs is constant
        return markdown_table(columns, rows)
    cells = dict(zip(columns, zip(*rows, strict=True), strict=True))
    common = ", ".join(
        f"{name} {column[0]}" for name, column in cells.items() if len({*column}) == 1
    )
    varying = {name: column for name, column in cells.items() if len({*column}) > 1}
    if not varying:
        return f"In all rows: {common}."
    table = markdown_table([*varying], [*zip(*varying.values(), strict=True)])
    return f"In all rows: {common}.\n\n{table}" if common else table
