"""The command `python -m research.difference`: train, export, and print the answers."""

from __future__ import annotations

import signal
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

import click

from research.difference.answers import (
    LEVELS,
    Interval,
    Record,
    Records,
    effect_of,
    effect_of_passes,
    sweeps,
    verdict,
)
from research.difference.design import PARTS, Training
from research.paper.jobs import read_lines, run_jobs, write_lines

DATA = Path(__file__).parent / "data" / "trainings.jsonl"
COLUMNS = ("coverage", "out_of_bounds", "collided")
"""Of the curve, that the table prints."""
HELD_OUT = ("covers_most", "explored", "clean_u")
"""Of the terrains kept apart, that the table prints."""


@click.command(context_settings={"show_default": True})
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/difference"))
@click.option("--workers", type=click.IntRange(min=1), default=2, help="Trainings at a time.")
@click.option(
    "--part", "parts", multiple=True, type=click.Choice([*PARTS]), help="[default: all, in order]"
)
@click.option("--moves", type=int, help="Of every training, to try it.")
@click.option("--list", "is_list", is_flag=True, help="Say what there is, and do nothing.")
@click.option("--export", "is_export", is_flag=True, help=f"Write what is in --out to {DATA.name}.")
@click.option("--table", "is_table", is_flag=True, help="Print the answers from the stored data.")
def main(
    out: Path,
    workers: int,
    parts: tuple[str, ...],
    moves: int | None,
    is_list: bool,
    is_export: bool,
    is_table: bool,
) -> None:
    """Train what the design has, one process a training; the same command goes on where it stopped."""
    trainings = [training for part in parts or PARTS for training in PARTS[part]()]
    if moves:
        fields = [{**vars(training), "moves": moves} for training in trainings]
        trainings = [Training(**own) for own in fields]
    if is_table:
        click.echo(table(read_stored()))
    elif is_list:
        for training in trainings:
            click.echo(f"{training.name}{': done' if training.is_done(out) else ''}")
    elif is_export:
        export(out)
    else:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        failures = run_jobs(trainings, out, workers, lambda done, total: None)
        for name, reason in failures.items():
            click.echo(f"{name} failed: {reason}")


def export(out: Path) -> None:
    """Write the logs of a folder to the stored data, a line a training, beside those of other trainings."""
    records = {**read_stored(), **read_records(sorted(out.glob("*/log.jsonl")))}
    lines = []
    for record in records.values():
        columns = sorted({name for line in record.lines for name in line} - {"kind"})
        lines.append(
            {
                "training": vars(record.training),
                "machines": record.machines,
                "curve": {name: [line.get(name) for line in record.lines] for name in columns},
                "result": record.result,
            }
        )
    write_lines(DATA, lines)


def read_stored(path: Path = DATA) -> Records:
    """Return the stored trainings."""
    records: dict[Training, Record] = {}
    for own in read_lines(path):
        rows = zip(*own["curve"].values(), strict=True)
        curve = tuple(dict(zip(own["curve"], row, strict=True)) for row in rows)
        training = Training(**own["training"])
        records[training] = Record(training, tuple(own["machines"]), curve, own["result"])
    return records


def read_records(paths: Iterable[Path]) -> Records:
    """Return the trainings of some logs."""
    records: dict[Training, Record] = {}
    for path in paths:
        head, *lines = read_lines(path) or [{}]
        curve = tuple(line for line in lines if line["kind"] == "curve")
        result = next((line for line in lines if line["kind"] == "result"), None)
        if curve:
            training = Training(**head["training"])
            records[training] = Record(training, tuple(head["machines"]), curve, result)
    return records


def kind_of(training: Training) -> tuple[str, ...]:
    """Return what trainings of one combination share."""
    return (
        training.level,
        training.passes,
        training.world,
        training.estimates,
        training.leaving,
    )


def table(records: Records) -> str:
    """Return the answers as two tables in Markdown."""
    head = ["level", "passes", "world", "estimates", "leaving", "seeds", "moves"]
    rows = [[*head, *COLUMNS, *HELD_OUT, "sweeps"], ["---"] * 14]
    ordered = sorted(records.values(), key=lambda record: kind_of(record.training), reverse=True)
    for kind, group in groupby(ordered, lambda record: kind_of(record.training)):
        own = list(group)
        moves = min(record.lines[-1]["moves"] for record in own)
        columns = [spread([record.last(name) for record in own]) for name in COLUMNS]
        results = [record.result for record in own if record.result]
        for name in HELD_OUT:
            columns.append(spread([result[name] for result in results]) if results else "")
        is_sweep = sweeps([record.last("coverage") for record in own])
        rows.append([*kind, str(len(own)), f"{moves:,}", *columns, "yes" if is_sweep else ""])
    effects = [["factor", "effect on coverage", "verdict"], ["---"] * 3]
    measured = {factor: effect_of(factor, records) for factor in LEVELS}
    for factor, effect in {**measured, "passes": effect_of_passes(records)}.items():
        if effect is None:
            effects.append([factor, "not all finished", "undecided"])
        else:
            effects.append([factor, words(effect), verdict(effect)])
    return "\n\n".join("\n".join(f"|{'|'.join(row)}|" for row in part) for part in (rows, effects))


def spread(values: list[float]) -> str:
    """Return the smallest and the largest of some values."""
    low, high = (f"{limit(values):.2f}" for limit in (min, max))
    return low if low == high else f"{low} to {high}"


def words(effect: Interval) -> str:
    """Return an effect with its interval."""
    return f"{effect.mean:+.2f} ({effect.low:+.2f} to {effect.high:+.2f})"


if __name__ == "__main__":
    main(prog_name="python -m research.difference")
