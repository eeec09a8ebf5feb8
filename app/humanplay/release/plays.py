"""What was played without a study, for other tools.

As Parquet tables and as a Minari dataset.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from humanplay.db.columns import TABLES
from humanplay.db.export import COLUMNS, export_to
from humanplay.db.reader import Reader
from humanplay.db.resimulation import simulate
from humanplay.db.trial import Trial
from humanplay.release.errors import ReleaseError, library
from humanplay.release.minari_data import write_plays
from humanplay.task import Run, counted


def to_parquet(folder: Path) -> list[Path]:
    """Write `episodes.csv` and `steps.csv` of a folder as Parquet beside them.

    Raises:
        ReleaseError: Without pyarrow.
    """
    pa, pq = library("pyarrow"), library("pyarrow.parquet")
    csv = library("pyarrow.csv")
    kinds = {
        "text": pa.string(),
        "integer": pa.int64(),
        "real": pa.float64(),
        "boolean": pa.bool_(),
    }
    written = []
    for table in COLUMNS:
        columns = TABLES[table].columns("export")
        schema = pa.schema(
            pa.field(
                column.name, kinds[column.exported_type], True, {"description": column.meaning}
            )
            for column in columns
        )
        types = {column.name: kinds[column.exported_type] for column in columns}
        options = csv.ConvertOptions(column_types=types, strings_can_be_null=True)
        rows = csv.read_csv(folder / f"{table}.csv", convert_options=options)
        written.append(folder / f"{table}.parquet")
        pq.write_table(rows.cast(schema), written[-1], compression="zstd")
    return written


def parquet_of(database: Path, folder: Path) -> str:
    """Write the finished episodes of a database, and their steps, as Parquet.

    Returns:
        A sentence on what was written.
    """
    with TemporaryDirectory() as place:
        sentence = export_to(database, Path(place), "all", lambda done, total: None)
        written = to_parquet(Path(place))
        folder.mkdir(parents=True, exist_ok=True)
        for path in written:
            shutil.move(path, folder / path.name)
    for path in written:
        sentence = sentence.replace(str(path.with_suffix(".csv")), str(folder / path.name))
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
