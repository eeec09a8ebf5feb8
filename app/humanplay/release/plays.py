"""What was played without a study, for other tools.

As Parquet tables and as a Minari dataset.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from humanplay.db.columns import TABLES
from humanplay.db.export import COLUMNS, ExportTable, Row, export_to
from humanplay.db.reader import Reader
from humanplay.db.resimulation import simulate
from humanplay.db.trial import Trial
from humanplay.release.errors import ReleaseError, library
from humanplay.release.minari_data import write_plays
from humanplay.release.tables import ParquetTable
from humanplay.task import Run, counted
from marsexplorer.files import replace_whole


class ParquetTables:
    """`episodes.parquet` and `steps.parquet` of a folder, of an export's rows.

    Used in a `with` statement; both appear whole at its end, or neither.

    Raises:
        ReleaseError: Without pyarrow.
    """

    def __init__(self, folder: Path) -> None:
        library("pyarrow.parquet")
        self.paths = [folder / f"{table}.parquet" for table in COLUMNS]
        self._tables: dict[ExportTable, ParquetTable] = {}
        self._stack = ExitStack()

    def __enter__(self) -> ParquetTables:
        for table, path in zip(COLUMNS, self.paths, strict=True):
            path.parent.mkdir(parents=True, exist_ok=True)
            place = self._stack.enter_context(replace_whole(path))
            columns = TABLES[table].columns("export")
            self._tables[table] = self._stack.enter_context(ParquetTable(place, columns))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool | None:
        return self._stack.__exit__(kind, error, trace)

    def keep(self, table: ExportTable, rows: Sequence[Row]) -> None:
        """Add the rows of an episode, as `export_to` hands them on."""
        self._tables[table].add([{**row, **_truths(table, row)} for row in rows])


def _truths(table: ExportTable, row: Row) -> Row:
    """The truth values of a row, which the database holds as 0 and 1."""
    truths = [column.name for column in TABLES[table].columns("export") if column.type == "boolean"]
    return {name: None if row.get(name) is None else bool(row[name]) for name in truths}


def parquet_of(database: Path, folder: Path) -> str:
    """Write the finished episodes of a database, and their steps, as Parquet.

    Returns:
        A sentence on what was written.
    """
    with TemporaryDirectory() as place, ParquetTables(folder) as tables:
        sentence = export_to(
            database, Path(place), "all", lambda done, total: None, keep=tables.keep
        )
    for path in tables.paths:
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
