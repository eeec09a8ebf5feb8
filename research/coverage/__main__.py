"""The command `python -m research.coverage --studies 2000 --seed 0`: measure and print the tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import groupby, product

import click

from app.cli.console import progress as progress_bar
from app.report.measured_coverage import COVERAGE_FILE, SCORE_POPULATIONS, Cell
from marsexplorer.evaluation.table import Progress
from research.coverage.measure import (
    PAIRED_ICCS,
    measure_cell,
    measure_false_alarms,
    measure_iqm,
    measure_ratio,
)

PLAYERS = (5, 8, 10, 20, 30)
ICCS = (0.0, 0.2, 0.5)
PERCENTAGES = {"ratio": measure_ratio, "paired": measure_false_alarms, "iqm": measure_iqm}
PLACE = ("population", "ICC")
"""The first columns of a table; the others have numbers."""


def measure_cells(
    studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[Cell]:
    """Yield every cell: populations x ICC x players; progress is called with (cells done, cells in all)."""
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


def across_players(
    cells: Sequence[Cell], entry: Callable[[Cell], str]
) -> Iterator[tuple[str, ...]]:
    """Yield a row for each population and ICC: what they are, then the entry for each number of players."""
    for (population, icc), row in groupby(cells, lambda cell: (cell.population, cell.icc)):
        yield population, f"{icc:g}", *(entry(cell) for cell in row)


def players_of(cells: Sequence[Cell]) -> list[str]:
    """Return the headings of the columns for numbers of players."""
    return [f"{count} players" for count in sorted({cell.players for cell in cells})]


def markdown_table(cells: Sequence[Cell]) -> str:
    """Return the table as README.md shows it: in each entry printed (t; width / t)."""
    rows = across_players(
        cells, lambda cell: f"{cell.printed:.1f} ({cell.t:.1f}; {cell.width:.2f})"
    )
    return "\n".join(table_lines(PLACE, players_of(cells), rows))


def headline_table(cells: Sequence[Cell]) -> str:
    """Return the table of the headline, of the populations in which players fail, as README.md shows it: score / steps."""
    failing = {population.name for population in SCORE_POPULATIONS if population.collisions}
    cells = [cell for cell in cells if cell.population in failing]
    rows = across_players(cells, lambda cell: f"{cell.headline:.1f} / {cell.headline_steps:.1f}")
    return "\n".join(table_lines(PLACE, players_of(cells), rows))


def further_lines(
    what: str, studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[str]:
    """Yield the lines of what is measured instead of the quoted table: one of PERCENTAGES."""
    places = [*product(SCORE_POPULATIONS, PAIRED_ICCS if what == "paired" else ICCS)]

    def rows() -> Iterator[tuple[str, ...]]:
        for done, (population, icc) in enumerate(places, 1):
            place = population.name, f"{icc:g}"
            measure = PERCENTAGES[what]
            shares = [measure(population, icc, count, studies, seed) for count in players]
            yield (*place, *(f"{share:.1f}" for share in shares))
            progress(done, len(places))

    return table_lines(PLACE, [f"{count} players" for count in players], rows())


@click.command(context_settings={"show_default": True})
@click.option("--studies", type=click.IntRange(min=20), default=2000, help="Studies of a cell.")
@click.option("--seed", type=click.IntRange(min=0), default=0)
@click.option("--players", multiple=True, type=click.IntRange(min=5), default=PLAYERS)
@click.option("--ratio", "what", flag_value="ratio", help="The interval of policy / people.")
@click.option("--paired", "what", flag_value="paired", help="False alarms of policy - people.")
@click.option("--iqm", "what", flag_value="iqm", help="The interval of the interquartile mean.")
@click.option("--save", is_flag=True, help="Also write the table that the report quotes.")
def main(studies: int, seed: int, players: tuple[int, ...], what: str | None, save: bool) -> None:
    """Measure the coverage of the report's intervals on simulated studies and print it as a Markdown table.

    --ratio, --paired and --iqm measure something else instead.
    """
    with progress_bar("simulating studies") as advance:
        if what:
            for line in further_lines(what, studies, seed, players, advance):
                click.echo(line)
            return
        cells = list(measure_cells(studies, seed, players, advance))
    click.echo(f"{markdown_table(cells)}\n\n{headline_table(cells)}")
    if save:
        document = {"studies": studies, "seed": seed, "cells": [asdict(cell) for cell in cells]}
        COVERAGE_FILE.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(prog_name="python -m research.coverage")
