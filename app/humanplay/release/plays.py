"""What was played without a study, for other tools.

As Parquet tables and as a Minari dataset.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from humanplay.db.columns import TABLES
from humanplay.db.export import COLUMNS, ExportTable, Keep, export_to
from humanplay.db.reader import Reader
from humanplay.db.resimulation import simulate
from humanplay.db.trial import Trial
from humanplay.release.errors import ReleaseError, library
from humanplay.release.minari_data import write_plays
from humanplay.release.tables import ParquetTable, with_truths
from humanplay.task import Run, counted
from marsexplorer.files import replace_whole


def parquet_paths(folder: Path) -> list[Path]:
    """Where `parquet_tables` writes the tables of an export."""
    return [folder / f"{table}.parquet" for table in COLUMNS]


@contextmanager
def parquet_tables(folder: Path) -> Iterator[Keep]:
    """Yield what takes an export's rows and writes them as Parquet.

    Both tables appear whole when the block ends well, or neither.

    Raises:
        ReleaseError: Without pyarrow.
    """
    library("pyarrow.parquet")  # before a folder is made
    folder.mkdir(parents=True, exist_ok=True)
    columns = {table: TABLES[table].columns("export") for table in COLUMNS}
    episodes, steps = parquet_paths(folder)
    with (
        replace_whole(episodes) as new_episodes,
        replace_whole(steps) as new_steps,
        ParquetTable(new_episodes, columns["episodes"]) as episode_rows,
        ParquetTable(new_steps, columns["steps"]) as step_rows,
    ):
        files: dict[ExportTable, ParquetTable] = {"episodes": episode_rows, "steps": step_rows}
        yield lambda table, rows: files[table].add(list(with_truths(rows, columns[table])))


def parquet_of(database: Path, folder: Path) -> str:
    """Write the finished episodes of a database, and their steps, as Parquet.

    Returns:
        A sentence on what was written.
    """
    with TemporaryDirectory() as place, parquet_tables(folder) as keep:
        sentence = export_to(database, Path(place), "all", lambda done, total: None, keep=keep)
    for path in parquet_paths(folder):
        sentence = sentence.replace(str(Path(place, path.with_suffix(".csv").name)), str(path))
    return sentence


def minari_of(database: Path, name: str, task: str | None = None) -> str:
    """Write the episodes of people that count as a Minari dataset, and say how many.

    Args:
        database: Where they were played.
        name: Of the dataset, such as "lake/people-v0".
        task: Whose episodes; without it there must be those of one.

    Raises:
        ReleaseError: There is none, or several tasks or configurations were played.
    """
    different = 0

    def plays(reader: Reader) -> Iterator[tuple[Trial, Run]]:
        nonlocal different
        for row in reader.finished("human"):
            if row["task"] == task:
                run, findings = simulate(row, reader.steps(row["id"]))
                if run is None or not all(finding.is_not_stepped for finding in findings):
                    different += 1
                else:
                    yield Trial.of(row), run

    with closing(Reader.open(database)) as reader, reader.snapshot():
        tasks = {row["task"] for row in reader.finished("human")}
        if task is None and len(tasks) > 1:
            raise ReleaseError(
                f"expected plays of one environment, found {', '.join(sorted(tasks))}"
            )
        task = task or next(iter(tasks), None)
        configurations = {
            row["config_hash"]: Trial.of(row).config
            for row in reader.finished("human")
            if row["task"] == task
        }
        if len(configurations) > 1:
            names = "; ".join(
                sorted(json.dumps(config.to_dict()) for config in configurations.values())
            )
            raise ReleaseError(
                f"a dataset has one configuration, and {database} has plays of {len(configurations)}: {names}. "
                "Play each in a database of its own"
            )
        count = write_plays(name, plays(reader))
    if not count:
        raise ReleaseError(f"no episode of a person in {database} counts and replays as recorded")
    left_out = f"; {counted(different, 'episode')} left out, which did not replay as recorded"
    return f"{counted(count, 'episode')} in the dataset {name}{left_out if different else ''}"
