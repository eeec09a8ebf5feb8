"""The command `marsexplorer bench`: how fast the environment is on this machine, beside others that are installed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, print_table, progress, reason

if TYPE_CHECKING:
    from marsexplorer.bench.figures import Figure


@click.command(short_help="Measure how fast the environment is here.")
@click.option("--quick", is_flag=True, help="An eighth of the work: about half a minute, and figures that wander more.")
@click.option("--json", "json_path", type=PATH, help="Also write every figure to this file.")
def bench(quick: bool, json_path: Path | None) -> None:
    """Measure the environment and print steps per CPU second, start-up, memory, and other environments beside it.

    Rates count CPU time, with moves chosen beforehand; terrains drawn at every reset, observations as uint8 codes and one
    Python call a step are included. They wander by a tenth on a busy machine. `two threads` needs an idle one and says
    so when it was not. A cold start is timed in a fresh process with an empty cache of compiled code.

    Others are measured when they are installed here: pip install minigrid crafter envpool pufferlib

    \b
    Examples:
      marsexplorer bench
      marsexplorer bench --quick --json speed.json
    """
    if json_path is None:
        _show(_measured(quick))
        return
    from marsexplorer.bench.figures import to_json
    from marsexplorer.files import write_whole

    try:
        with write_whole(json_path) as file:
            figures = _measured(quick)
            file.write(to_json(figures).encode() + b"\n")
    except OSError as error:
        raise click.ClickException(f"cannot write {json_path}: {reason(error)}; choose another --json") from error
    _show(figures)


def _measured(quick: bool) -> list[Figure]:
    """Return every figure, measured one after the other so that none disturbs another."""
    from marsexplorer.bench import core, peers, start

    measures: list[Callable[[], Figure | list[Figure]]] = [*core.measures(quick), lambda: start.first_steps(quick)]
    measures += [partial(peers.measure, peer, 0.5 if quick else 2.0) for peer in peers.PEERS]
    found: list[Figure] = []
    with progress("measuring (the rules are compiled first)") as advance:
        for number, measure in enumerate(measures):
            advance(number, len(measures))
            figures = measure()
            found += figures if isinstance(figures, list) else [figures]
    return found


def _show(figures: list[Figure]) -> None:
    sizes = list(dict.fromkeys(figure.at for figure in figures if figure.at))
    rates = {(figure.name, figure.at): figure for figure in figures if figure.at}
    grid = []
    for name in dict.fromkeys(name for name, _ in rates):
        cells = [rates.get((name, at)) for at in sizes]
        grid.append((name, *(f"{cell.value / 1e6:.2f}" if cell and cell.value else "" for cell in cells)))
    print_table("Million steps per CPU second", ("worlds", *sizes), grid)
    absent = [figure for figure in figures if figure.value is None and figure.note.startswith("not installed")]
    rest = [figure for figure in figures if not figure.at and figure not in absent]
    rows = [(figure.name, _value(figure), _target(figure), figure.note) for figure in rest]
    print_table("Everything else", ("what", "measured", "wanted", "note"), rows)
    for figure in absent:
        click.echo(f"{figure.name} is {figure.note}")
    wanted = [figure for figure in figures if figure.target is not None]
    missed = [f"{figure.name} {figure.at}".strip() for figure in wanted if figure.verdict == "missed"]
    click.echo(
        f"{len(wanted) - len(missed)} of {len(wanted)} targets reached" + "".join(f"\nmissed: {name}" for name in missed)
    )


def _value(figure: Figure) -> str:
    if figure.value is None:
        return "-"
    number = f"{figure.value:,.0f}" if figure.value >= 100 else f"{figure.value:.2f}"
    return f"{number} {figure.unit}"


def _target(figure: Figure) -> str:
    if figure.target is None:
        return ""
    return f"{'at most' if figure.at_most else 'at least'} {figure.target:,g}"
