"""How often the printed interval covers the truth, measured: `python -m app.statistics.coverage --studies 2000 --seed 0`.

A simulated study is scores[players, terrains] = mean + player + terrain + episode. Its truth is the mean over the population of
players on its own terrains, as in a report; "new terrains" is judged by the mean over terrains as well. Every interval comes
from the functions the report uses. A score's long tail points down; steps to 99 % mirror it, and so do their intervals.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress as ProgressBar
from scipy import stats

from app.statistics.comparisons import crossed_means, drawn_terrains, log_interval, new_terrains_interval
from app.statistics.coverage_table import COVERAGE_FILE, SCORE_POPULATIONS, Cell, ScorePopulation
from app.statistics.intervals import TAIL, Ends, bootstrap_t, guaranteed_covers, printed_interval
from marsexplorer.evaluation.intervals import Floats, t_interval
from marsexplorer.evaluation.run import Progress

TERRAINS = 30
PLAYERS = (5, 10, 20, 30)
ICCS = (0.0, 0.2, 0.5)
TERRAIN_SHARE = 0.2
"""Of the variance of an episode's score."""
SCORE_BOUNDS = (-0.18, 1.0)
COLLISION_COST = 0.55
"""Of a collision, in score."""
POLICY_SCORE = 0.92
STUDIES_AT_ONCE = 250
"""Studies worked on at a time."""


def simulate_studies(
    population: ScorePopulation, icc: float, players: int, studies: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return scores float64[studies, players, TERRAINS], and what each terrain adds float64[studies, TERRAINS] (mean 0).

    The truth on a study's terrains is `mean_score(population)` plus the mean of what they add.
    """
    shape = (studies, players, TERRAINS)
    if not population.collisions:
        player, terrain = (_drawn(population.shape, size, rng) for size in ((studies, players, 1), (studies, 1, TERRAINS)))
        # the ICC is of the one-way model, in which terrains count as variance within players
        terrain_share = min(TERRAIN_SHARE, 1 - icc)
        episode = _drawn(population.shape, shape, rng)
        shares = (icc, terrain_share, 1 - icc - terrain_share)
        parts = zip(shares, (player, terrain, episode), strict=True)
        scores: Floats = 0.9 + 0.03 * sum(np.sqrt(share) * part for share, part in parts)
        return scores, 0.03 * np.sqrt(terrain_share) * terrain[:, 0]
    rate = np.full((studies, players, 1), population.collisions)
    if icc:
        spread = 1 / icc - 1
        rate = rng.beta(population.collisions * spread, (1 - population.collisions) * spread, (studies, players, 1))
    terrain = 0.004 * rng.standard_normal((studies, 1, TERRAINS))
    played = 0.94 + 0.004 * rng.standard_normal((studies, players, 1)) + terrain + 0.008 * rng.standard_normal(shape)
    return played - COLLISION_COST * (rng.random(shape) < rate), terrain[:, 0]


def _drawn(shape: str, size: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Return draws of mean 0 and variance 1 whose long tail, if any, points down."""
    if shape == "exponential":
        return 1 - rng.standard_exponential(size)
    if shape == "lognormal":
        sigma2 = 0.64
        drawn = np.exp(np.sqrt(sigma2) * rng.standard_normal(size))
        scaled: Floats = (np.exp(sigma2 / 2) - drawn) / np.sqrt((np.exp(sigma2) - 1) * np.exp(sigma2))
        return scaled
    return rng.standard_normal(size)


def measure_cell(population: ScorePopulation, icc: float, players: int, studies: int, seed: int) -> Cell:
    """Return the coverage in one cell; the same for the same seed."""
    rng = np.random.default_rng([seed, players, round(100 * icc), SCORE_POPULATIONS.index(population)])
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    truth, everywhere = mean_score(population) + terrain.mean(1), np.full(studies, mean_score(population))
    means = scores.mean(2)
    t, printed = t_interval(means), printed_interval(means)
    stacks = [slice(at, at + STUDIES_AT_ONCE) for at in range(0, studies, STUDIES_AT_ONCE)]
    bootstrap = _joined([bootstrap_t(means[stack]) for stack in stacks])
    guaranteed = np.concatenate([guaranteed_covers(means[stack], SCORE_BOUNDS, truth[stack]) for stack in stacks])
    return Cell(
        population=population.name,
        icc=icc,
        players=players,
        studies=studies,
        printed=_percent_covered(printed, truth),
        below=100 * float((truth < printed[0]).mean()),
        above=100 * float((truth > printed[1]).mean()),
        width=float(np.median((printed[1] - printed[0]) / (t[1] - t[0]))),
        t=_percent_covered(t, truth),
        bootstrap=_percent_covered(bootstrap, truth),
        guaranteed=100 * float(guaranteed.mean()),
        new_terrains=_percent_covered(_new_terrains(scores), everywhere),
        pooled=_percent_covered(_pooled(scores), truth),
    )


def mean_score(population: ScorePopulation) -> float:
    """Return the mean score over players and terrains."""
    return 0.94 - COLLISION_COST * population.collisions if population.collisions else 0.9


def measure_ratio(population: ScorePopulation, icc: float, players: int, studies: int, seed: int) -> float:
    """Return how often (percent) the interval of policy / people covers the ratio of the means over players and terrains.

    The policy scores 0.92 in the mean, on each terrain what the terrain adds and a little of its own.
    """
    rng = np.random.default_rng([seed, players, round(100 * icc), SCORE_POPULATIONS.index(population)])
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = POLICY_SCORE + terrain + 0.01 * rng.standard_normal(terrain.shape)
    truth, covered = POLICY_SCORE / mean_score(population), 0
    for table, own in zip(scores, values, strict=True):
        ratio = float(own.mean() / table.mean())
        ends = log_interval(drawn_terrains(own, players), crossed_means(table), ratio, table)
        covered += ends is not None and ends[0] <= truth <= ends[1]
    return 100 * covered / studies


def _new_terrains(scores: Floats) -> Ends:
    ends = np.array([new_terrains_interval(table) for table in scores])
    return ends[:, 0], ends[:, 1]


def _pooled(scores: Floats) -> Ends:
    return t_interval(scores.reshape(len(scores), -1))


def _joined(parts: Sequence[Ends]) -> Ends:
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _percent_covered(ends: Ends, truth: Floats) -> float:
    return 100 * float(((ends[0] <= truth) & (truth <= ends[1])).mean())


def measure_cells(
    studies: int, seed: int, players: Sequence[int] = PLAYERS, progress: Progress | None = None
) -> Iterator[Cell]:
    """Yield every cell: populations x ICC x players; progress is called with (cells done, cells in all)."""
    cells = [(population, icc, count) for population in SCORE_POPULATIONS for icc in ICCS for count in players]
    for done, (population, icc, count) in enumerate(cells, 1):
        yield measure_cell(population, icc, count, studies, seed)
        if progress:
            progress(done, len(cells))


def markdown_table(cells: Sequence[Cell]) -> str:
    """Return the table as docs/report.md shows it."""
    heads = ("population", "ICC", "players", "**printed**", "missed low / high", "width / t", "t", "bootstrap-t")
    lines: list[tuple[str, ...]] = [(*heads, "guaranteed", "new terrains", "pooled"), ("---",) * 3 + ("---:",) * 8]
    for cell in cells:
        missed = f"{cell.below:.1f} / {cell.above:.1f}"
        shares = (cell.t, cell.bootstrap, cell.guaranteed, cell.new_terrains, cell.pooled)
        first = (cell.population, f"{cell.icc:g}", str(cell.players), f"**{cell.printed:.1f}**", missed, f"{cell.width:.2f}")
        lines.append((*first, *(f"{share:.1f}" for share in shares)))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _ratios(studies: int, seed: int, players: Sequence[int], progress: Progress) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a Markdown table: population, ICC, and the coverage of the ratio's interval by players."""
    yield ("population", "ICC", *(f"{count} players" for count in players))
    yield ("---", "---", *("---:" for _ in players))
    rows = [(population, icc) for population in SCORE_POPULATIONS for icc in ICCS]
    for done, (population, icc) in enumerate(rows, 1):
        found = [measure_ratio(population, icc, count, studies, seed) for count in players]
        yield (population.name, f"{icc:g}", *(f"{share:.1f}" for share in found))
        progress(done, len(rows))


def coverage_error(coverage: float, studies: int) -> float:
    """Return the half-width (percentage points) within which a measured coverage lies of the true one, 95 % of the time."""
    share = coverage / 100
    return float(100 * stats.norm.ppf(1 - TAIL) * np.sqrt(share * (1 - share) / studies))


@click.command()
@click.option("--studies", type=click.IntRange(min=20), default=2000, show_default=True, help="Simulated studies a cell.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--players", multiple=True, type=click.IntRange(min=5), help="Numbers of players; default 5, 10, 20, 30.")
@click.option("--ratio", is_flag=True, help="Measure the interval of policy / people instead, which takes as long.")
@click.option("--save", is_flag=True, help="Also write the table that the report quotes.")
def main(studies: int, seed: int, players: tuple[int, ...], ratio: bool, save: bool) -> None:
    """Measure the coverage of the report's intervals and print it as a Markdown table."""
    if ratio:
        with _progress_bar() as advance:
            rows = list(_ratios(studies, seed, players or PLAYERS, advance))
        click.echo("\n".join("| " + " | ".join(row) + " |" for row in rows))
        return
    with _progress_bar() as advance:
        cells = list(measure_cells(studies, seed, players or PLAYERS, advance))
    click.echo(markdown_table(cells))
    if save:
        document = {"studies": studies, "seed": seed, "cells": [asdict(cell) for cell in cells]}
        COVERAGE_FILE.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


@contextmanager
def _progress_bar() -> Iterator[Progress]:
    """Yield a function that moves a bar on stderr; nothing is drawn where stderr is no terminal."""
    console = Console(stderr=True)
    with ProgressBar(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("simulating studies", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


if __name__ == "__main__":
    main()
