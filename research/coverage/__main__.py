"""The command `python -m research.coverage --studies 2000 --seed 0`: measure and print the tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict

import click

from app.cli.console import progress as progress_bar
from app.report.measured_coverage import COVERAGE_FILE, SCORE_POPULATIONS, Cell, ScorePopulation
from marsexplorer.evaluation.table import Progress
from research.coverage.measure import (
    PAIRED_ICCS,
    measure_cell,
    measure_false_alarms,
    measure_iqm,
    measure_mixed_model,
    measure_ratio,
)

PLAYERS = (5, 10, 20, 30)
ICCS = (0.0, 0.2, 0.5)


def measure_cells(
    studies: int, seed: int, players: Sequence[int] = PLAYERS, progress: Progress | None = None
) -> Iterator[Cell]:
    """Yield every cell: populations x ICC x players; progress is called with (cells done, cells in all)."""
    cells = [
        (population, icc, count)
        for population in SCORE_POPULATIONS
        for icc in ICCS
        for count in players
    ]
    for done, (population, icc, count) in enumerate(cells, 1):
        yield measure_cell(population, icc, count, studies, seed)
        if progress:
            progress(done, len(cells))


def markdown_table(cells: Sequence[Cell]) -> str:
    """Return the table as README.md shows it."""
    heads = ("population", "ICC", "players", "**printed**", "missed low / high", "width / t", "t")
    lines: list[tuple[str, ...]] = [
        (*heads, "guaranteed", "new terrains", "pooled"),
        ("---",) * 3 + ("---:",) * 7,
    ]
    for cell in cells:
        missed = f"{cell.below:.1f} / {cell.above:.1f}"
        shares = (cell.t, cell.guaranteed, cell.new_terrains, cell.pooled)
        first = (
            cell.population,
            f"{cell.icc:g}",
            str(cell.players),
            f"**{cell.printed:.1f}**",
            missed,
            f"{cell.width:.2f}",
        )
        lines.append((*first, *(f"{share:.1f}" for share in shares)))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def headline_table(cells: Sequence[Cell]) -> str:
    """Return the table of the headline, of the populations in which players fail, as README.md shows it."""
    heads = (
        "population",
        "ICC",
        "players",
        "guaranteed is headline",
        "**headline, score**",
        "printed, score",
    )
    lines: list[tuple[str, ...]] = [
        (*heads, "**headline, steps**", "printed, steps"),
        ("---",) * 3 + ("---:",) * 5,
    ]
    failing = {population.name for population in SCORE_POPULATIONS if population.collisions}
    for cell in (each for each in cells if each.population in failing):
        shares = (
            f"**{cell.headline:.1f}**",
            f"{cell.printed:.1f}",
            f"**{cell.headline_steps:.1f}**",
            f"{cell.printed_steps:.1f}",
        )
        lines.append(
            (
                cell.population,
                f"{cell.icc:g}",
                str(cell.players),
                f"{cell.guaranteed_headline:.1f}",
                *shares,
            )
        )
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


Measured = Callable[[ScorePopulation, float, int, int, int], float]
"""(population, ICC, players, studies, seed) -> percent."""
FURTHER: dict[str, tuple[Measured, Sequence[float]]] = {
    "ratio": (measure_ratio, ICCS),
    "paired": (measure_false_alarms, PAIRED_ICCS),
    "iqm": (measure_iqm, ICCS),
}
"""What is measured instead of the quoted table, and at which ICCs."""


def _percentages(
    measure: Measured,
    iccs: Sequence[float],
    studies: int,
    seed: int,
    players: Sequence[int],
    progress: Progress,
) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a Markdown table: population, ICC, and what is measured by players."""
    yield ("population", "ICC", *(f"{count} players" for count in players))
    yield ("---", "---", *("---:" for _ in players))
    rows = [(population, icc) for population in SCORE_POPULATIONS for icc in iccs]
    for done, (population, icc) in enumerate(rows, 1):
        found = [measure(population, icc, count, studies, seed) for count in players]
        yield (population.name, f"{icc:g}", *(f"{share:.1f}" for share in found))
        progress(done, len(rows))


def _mixed_models(
    studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a Markdown table of the mixed model's coverage."""
    yield ("population", "ICC", "players", "converged", "mean", "slope", "terrains")
    yield (*("---",) * 3, *("---:",) * 4)
    cells = [
        (population, icc, count)
        for population in SCORE_POPULATIONS
        for icc in ICCS
        for count in players
    ]
    for done, (population, icc, count) in enumerate(cells, 1):
        found = measure_mixed_model(population, icc, count, studies, seed)
        shares = (found.converged, found.mean, found.slope, found.terrains)
        yield (population.name, f"{icc:g}", str(count), *(f"{share:.1f}" for share in shares))
        progress(done, len(cells))


def _further(
    what: str, studies: int, seed: int, players: Sequence[int], progress: Progress
) -> Iterator[tuple[str, ...]]:
    """Return the rows of what is measured instead of the quoted table."""
    if what == "mixed":
        return _mixed_models(studies, seed, players, progress)
    measure, iccs = FURTHER[what]
    return _percentages(measure, iccs, studies, seed, players, progress)


@click.command()
@click.option(
    "--studies",
    type=click.IntRange(min=20),
    default=2000,
    show_default=True,
    help="Simulated studies a cell.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--players",
    multiple=True,
    type=click.IntRange(min=5),
    help="Numbers of players; default 5, 10, 20, 30.",
)
@click.option(
    "--ratio", "what", flag_value="ratio", help="Measure the interval of policy / people instead."
)
@click.option(
    "--paired",
    "what",
    flag_value="paired",
    help="Measure the false alarms of the test of policy - people instead.",
)
@click.option(
    "--iqm",
    "what",
    flag_value="iqm",
    help="Measure the interval of the interquartile mean instead.",
)
@click.option(
    "--mixed",
    "what",
    flag_value="mixed",
    help="Measure the mixed model's intervals instead, at minutes a row.",
)
@click.option("--save", is_flag=True, help="Also write the table that the report quotes.")
def main(studies: int, seed: int, players: tuple[int, ...], what: str | None, save: bool) -> None:
    """Measure the coverage of the report's intervals and print it as a Markdown table."""
    if what:
        with progress_bar("simulating studies") as advance:
            for row in _further(what, studies, seed, players or PLAYERS, advance):
                click.echo("| " + " | ".join(row) + " |")
        return
    with progress_bar("simulating studies") as advance:
        cells = list(measure_cells(studies, seed, players or PLAYERS, advance))
    click.echo(f"{markdown_table(cells)}\n\n{headline_table(cells)}")
    if save:
        document = {"studies": studies, "seed": seed, "cells": [asdict(cell) for cell in cells]}
        COVERAGE_FILE.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
