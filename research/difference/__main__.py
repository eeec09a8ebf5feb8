"""`python -m research.difference`: train, export, and print the answers."""

from __future__ import annotations

import signal
from pathlib import Path

import click

from marsexplorer.evaluation import RULES
from research.difference.answers import (
    DATA,
    RULE_RESULTS,
    read_records,
    read_stored,
    reasons,
    table,
)
from research.difference.design import PARTS, Training
from research.difference.held_out import play_rule
from research.paper.jobs import run_jobs, write_lines


@click.command(context_settings={"show_default": True})
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/difference"))
@click.option("--workers", type=click.IntRange(min=1), default=2, help="Trainings at a time.")
@click.option(
    "--part", "parts", multiple=True, type=click.Choice([*PARTS]), help="[default: all, in order]"
)
@click.option("--moves", type=int, help="Of every training, to try it.")
@click.option("--list", "is_list", is_flag=True, help="Say what there is, and do nothing.")
@click.option("--export", "is_export", is_flag=True, help=f"Write what is in --out to {DATA.name}.")
@click.option(
    "--rules", "is_rules", is_flag=True, help=f"Play the rules; write {RULE_RESULTS.name}."
)
@click.option("--table", "is_table", is_flag=True, help="Print the answers from the stored data.")
def main(
    out: Path,
    workers: int,
    parts: tuple[str, ...],
    moves: int | None,
    is_list: bool,
    is_export: bool,
    is_rules: bool,
    is_table: bool,
) -> None:
    """Train what the design has, one process a training; run it again to go on."""
    trainings = [training for part in parts or PARTS for training in PARTS[part]()]
    if moves:
        fields = [{**vars(training), "moves": moves} for training in trainings]
        trainings = [Training(**training_fields) for training_fields in fields]
    if is_table:
        click.echo(f"{table(read_stored())}\n\n{reasons(read_stored())}")
    elif is_list:
        for training in trainings:
            click.echo(f"{training.name}{': done' if training.is_done(out) else ''}")
    elif is_export:
        export(out)
    elif is_rules:
        write_lines(RULE_RESULTS, [play_rule(name) for name in RULES])
    else:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        failures = run_jobs(trainings, out, workers, lambda done, total: None)
        for name, reason in failures.items():
            click.echo(f"{name} failed: {reason}", err=True)
        if failures:
            raise click.exceptions.Exit(1)


def export(out: Path) -> None:
    """Write a folder's logs to the stored data, a line a training, beside the others."""
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


if __name__ == "__main__":
    main(prog_name="python -m research.difference")
