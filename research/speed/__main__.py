"""The command `python -m research.speed`: the environment's speed beside others'."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import click

from humanplay.command.console import print_table, progress, reason
from humanplay.command.options import PATH
from marsexplorer.files import write_whole
from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load
from research.speed import core, decisions, peers, start
from research.speed.figures import Figure, to_json


@click.command()
@click.option(
    "--quick",
    is_flag=True,
    help="An eighth of the work: about half a minute, and figures that vary more.",
)
@click.option("--json", "json_path", type=PATH, help="Also write every figure to this file.")
@click.option(
    "--policy",
    "policies",
    multiple=True,
    help="Measure how long this policy takes for a move instead; again for more.",
)
def bench(quick: bool, json_path: Path | None, policies: tuple[str, ...]) -> None:
    """Measure the environment's speed, start-up and memory, and other environments.

    Rates are steps per second of CPU time. The moves are chosen beforehand; drawing a terrain at
    every reset, observations as uint8 codes and one Python call for each step are included. Rates
    vary by a tenth on a busy machine. `two threads` needs an idle machine; its note says when the
    machine was busy. A cold start is timed in a fresh process with an empty cache of compiled code.

    With --policy, CPU milliseconds a move on 21x21 and 84x84: alone, and for a network also in a
    stack of 32 boards.

    Other environments are measured when they are installed: pip install minigrid crafter envpool

    \b
    Examples:
      python -m research.speed
      python -m research.speed --quick --json speed.json
      python -m research.speed --policy ppo --policy frontier-priced
    """
    if json_path is None:
        _print_figures(_measure(quick, policies))
        return
    try:
        with write_whole(json_path) as file:
            figures = _measure(quick, policies)
            file.write(to_json(figures).encode() + b"\n")
    except OSError as error:
        raise click.ClickException(
            f"cannot write {json_path}: {reason(error)}; choose another --json"
        ) from error
    _print_figures(figures)


def _measure(quick: bool, names: tuple[str, ...]) -> list[Figure]:
    """Measure all, one after the other so that none disturbs another."""
    measures: list[Callable[[], Figure | list[Figure]]]
    if names:
        try:
            for name in names:
                load(name)
        except (PolicyNotFoundError, PolicyFileError) as error:
            raise click.ClickException(str(error)) from error
        measures = [partial(decisions.decide, name, side) for name in names for side in (21, 84)]
    else:
        measures = [*core.measures(quick), lambda: start.first_steps(quick)]
        measures += [partial(peers.measure, peer, 0.5 if quick else 2.0) for peer in peers.PEERS]
    figures: list[Figure] = []
    with progress("measuring (the rules are compiled first)") as advance:
        for number, measure in enumerate(measures):
            advance(number, len(measures))
            measured = measure()
            figures += measured if isinstance(measured, list) else [measured]
    return figures


def _print_figures(figures: list[Figure]) -> None:
    rates = {(figure.name, figure.at): figure for figure in figures if figure.at}
    sizes = list(dict.fromkeys(at for _, at in rates))
    rows = []
    for name in dict.fromkeys(name for name, _ in rates):
        speeds = (rates[name, at].value if (name, at) in rates else None for at in sizes)
        rows.append((name, *(f"{speed / 1e6:.2f}" if speed else "" for speed in speeds)))
    if rows:
        print_table("Million steps per CPU second", ("worlds", *sizes), rows)
    absent = [figure for figure in figures if figure.note.startswith("not installed")]
    rest = [figure for figure in figures if not figure.at and figure not in absent]
    cells = [(figure.name, _value(figure), _target(figure), figure.note) for figure in rest]
    print_table("Everything else", ("what", "measured", "wanted", "note"), cells)
    for figure in absent:
        click.echo(f"{figure.name} is {figure.note}")
    wanted = [figure for figure in figures if figure.target is not None]
    missed = [figure for figure in wanted if figure.verdict == "missed"]
    if wanted:
        click.echo(f"{len(wanted) - len(missed)} of {len(wanted)} targets reached")
    for figure in missed:
        click.echo(f"missed: {figure.name} {figure.at}".strip())


def _value(figure: Figure) -> str:
    if figure.value is None:
        return "-"
    number = f"{figure.value:,.0f}" if figure.value >= 100 else f"{figure.value:.2f}"
    return f"{number} {figure.unit}"


def _target(figure: Figure) -> str:
    if figure.target is None:
        return ""
    return f"{'at most' if figure.at_most else 'at least'} {figure.target:,g}"


if __name__ == "__main__":
    bench()
