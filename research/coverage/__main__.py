"""The command `python -m research.coverage`: measure and print the tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby, product

import click

from humanplay.command.console import progress as progress_bar
from humanplay.report.measured_coverage import COVERAGE_FILE, SCORE_POPULATIONS, Cell
from humanplay.report.statistics.intervals import UNSEEN
from marsexplorer.evaluation.table import Progress
from research.coverage.measure import (
    PAIRED_ICCS,
    measure_cell,
    measure_false_alarms,
    measure_power,
    measure_ratio,
    measure_width,
)
from research.coverage.simulated_studies import PAPER

PLAYERS = (5, 8, 10, 20, 30)
ICCS = (0.0, 0.2, 0.5)
PERCENTAGES = {"ratio": measure_ratio, "paired": measure_false_alarms}
PLACE = ("population", "ICC")
"""The first columns of a table; the others have numbers."""
SHARES = (0.0, 0.1, UNSEEN, 0.5)
"""Of an unseen participant, for which power and width are printed."""
AHEAD = (25.0, -25.0, 39.0, -39.0)
POLICY_SDS = (0.0, 20.0, 45.0)


def measure_cells(
    studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[Cell]:
    """Yield every cell: populations x ICC x players.

    progress is called with (cells done, cells in all).
    """
    cells = [*product(SCORE_POPULATIONS, ICCS, players)]
    for done, cell in enumerate(cells, 1):
        yield measure_cell(*cell, studies, seed)
        progress(done, len(cells))


def table_lines(
    place: Sequence[str], numbers: Sequence[str], rows: Iterable[Sequence[str]]
) -> Iterator[str]:
    """Yield the lines of a Markdown table, whose numbers stand to the right."""
    for row in ((*place, *numbers), ("---",) * len(place) + ("---:",) * len(numbers), *rows):
        yield f"|{'|'.join(row)}|"


def markdown_table(cells: Sequence[Cell], text_of: Callable[[Cell], str]) -> str:
    """A row for each population and ICC, with a text for each number of players."""
    rows = [
        (population, f"{icc:g}", *(text_of(cell) for cell in row))
        for (population, icc), row in groupby(cells, lambda cell: (cell.population, cell.icc))
    ]
    heads = [f"{count} players" for count in sorted({cell.players for cell in cells})]
    return "\n".join(table_lines(PLACE, heads, rows))


def drawn_entry(cell: Cell) -> str:
    """Return coverage for other terrains: score / steps (width over that of t)."""
    return f"{cell.score:.1f} / {cell.steps:.1f} ({cell.width:.2f})"


def own_entry(cell: Cell) -> str:
    """Return coverage for these terrains: score / steps."""
    return f"{cell.own_score:.1f} / {cell.own_steps:.1f}"


def further_lines(
    subject: str, studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[str]:
    """Yield the lines of another measure than the quoted table, one of PERCENTAGES."""
    places = [*product(SCORE_POPULATIONS, PAIRED_ICCS if subject == "paired" else ICCS)]

    def rows() -> Iterator[tuple[str, ...]]:
        for done, (population, icc) in enumerate(places, 1):
            measure = PERCENTAGES[subject]
            shares = [measure(population, icc, count, studies, seed) for count in players]
            yield population.name, f"{icc:g}", *(f"{share:.1f}" for share in shares)
            progress(done, len(places))

    return table_lines(PLACE, [f"{count} players" for count in players], rows())


def power_lines(studies: int, seed: int, progress: Progress) -> Iterator[str]:
    """Yield width and power at the paper's spreads, by an unseen participant's share."""
    places = [*product(SHARES, POLICY_SDS)]

    def rows() -> Iterator[tuple[str, ...]]:
        for done, (unseen, policy_sd) in enumerate(places, 1):
            shares = (
                f"{measure_power(ahead, policy_sd, 0.05, unseen, studies, seed):.0f} / "
                f"{measure_power(ahead, policy_sd, 0.01, unseen, studies, seed):.0f}"
                for ahead in AHEAD
            )
            width = f"{measure_width(unseen, studies, seed):.2f}"
            yield f"{unseen:g}", f"{policy_sd:g}", width, *shares
            progress(done, len(places))

    sides = (f"{'policy' if ahead > 0 else 'people'} better by {abs(ahead):g}" for ahead in AHEAD)
    return table_lines(("unseen", "policy's SD"), ("width / t", *sides), rows())


@click.command(context_settings={"show_default": True})
@click.option("--studies", type=click.IntRange(min=20), default=2000, help="Studies of a cell.")
@click.option("--seed", type=click.IntRange(min=0), default=0)
@click.option("--players", multiple=True, type=click.IntRange(min=5), default=PLAYERS)
@click.option("--ratio", "subject", flag_value="ratio", help="The interval of policy / people.")
@click.option("--paired", "subject", flag_value="paired", help="False alarms of policy - people.")
@click.option("--power", "subject", flag_value="power", help=f"Power at {PAPER}.")
@click.option("--save", is_flag=True, help="Also write the table that the report quotes.")
def main(
    studies: int, seed: int, players: tuple[int, ...], subject: str | None, save: bool
) -> None:
    """Measure the coverage of the report's interval on simulated studies.

    --ratio, --paired and --power measure something else instead.
    """
    with progress_bar("simulating studies") as advance:
        if subject:
            lines = (
                power_lines(studies, seed, advance)
                if subject == "power"
                else further_lines(subject, studies, seed, players, advance)
            )
            for line in lines:
                click.echo(line)
            return
        cells = list(measure_cells(studies, seed, players, advance))
    click.echo(f"{markdown_table(cells, drawn_entry)}\n\n{markdown_table(cells, own_entry)}")
    if save:
        document = {"studies": studies, "seed": seed, "cells": [asdict(cell) for cell in cells]}
        COVERAGE_FILE.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(prog_name="python -m research.coverage")
