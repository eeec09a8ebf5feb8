"""The tables of a release as Parquet and CSV.

They are written from its own database by the queries of `queries.sql`.
"""

from __future__ import annotations

import csv
import re
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from humanplay.db.columns import BUNDLE_TABLES, Column, bundle_table
from humanplay.db.database import rows, stream
from humanplay.db.export import csv_cell
from humanplay.db.trial import Trial
from humanplay.release.errors import library
from humanplay.task import Run
from humanplay.task.registration import environment_of

QUERIES = Path(__file__).with_name("queries.sql")
TableRow = dict[str, Any]
ROWS_PER_GROUP = 20_000
"""The rows of one group in a Parquet file."""

PARQUET = tuple(name for name in BUNDLE_TABLES if name != "scores")
"""The tables that are Parquet files; every table is a CSV file."""


@cache
def queries() -> dict[str, str]:
    """Table -> its SELECT."""
    parts = re.split(r"^-- table: (\w+)$", QUERIES.read_text(encoding="utf-8"), flags=re.M)
    pairs = zip(parts[1::2], parts[2::2], strict=True)
    return {name: text.strip().removesuffix(";") for name, text in pairs}


def select(conn: sqlite3.Connection, table: str) -> Iterator[TableRow]:
    """Yield the rows of a table from a bundle's database, columns in their order.

    Truth values are bool, and actions are names.
    """
    columns = bundle_table(table)[1]
    actions = _actions(conn) if table == "steps" else ()
    for row in with_truths(stream(conn, queries()[table]), columns):
        if table == "steps":
            row["action"] = actions[row["action"]]
        yield {column.name: row[column.name] for column in columns}


def with_truths(
    rows: Iterable[Mapping[str, object]], columns: Sequence[Column]
) -> Iterator[TableRow]:
    """Yield the rows with truth values as bool, which SQLite holds as 0 and 1."""
    names = [column.name for column in columns if column.type == "boolean"]
    for row in rows:
        yield {**row, **{name: bool(row[name]) for name in names if row.get(name) is not None}}


def _actions(conn: sqlite3.Connection) -> Sequence[str]:
    """The names of the actions, by code, of the task that a bundle's episodes are of."""
    tasks = rows(conn, "SELECT task FROM episodes LIMIT 1")
    return environment_of(tasks[0]["task"]).actions if tasks else ()


def released_episodes(conn: sqlite3.Connection) -> Iterator[tuple[TableRow, Run]]:
    """Yield every episode of a release's database, oldest first.

    Each is its row of the table of episodes, and its replay.
    """
    for header in select(conn, "episodes"):
        (row,) = rows(conn, "SELECT * FROM episodes WHERE id = ?", header["episode"])
        of_episode = "SELECT * FROM steps WHERE episode_id = ? ORDER BY step"
        steps = rows(conn, of_episode, header["episode"])
        trial = Trial.of(row)
        yield header, trial.environment.replay_record(trial.record(steps))


def write_tables(folder: Path, conn: sqlite3.Connection) -> dict[str, int]:
    """Write every table of a release, as CSV and all but `scores` as Parquet.

    In CSV what is absent is empty, and truth values are true and false. In Parquet each column
    carries its meaning.

    Returns:
        The rows by file.
    """
    (folder / "parquet").mkdir()
    (folder / "csv").mkdir()
    counts: dict[str, int] = {}
    for table in BUNDLE_TABLES:
        names = [f"csv/{table}.csv", *([f"parquet/{table}.parquet"] if table in PARQUET else [])]
        with ExitStack() as stack:
            opened = [_WRITERS[Path(name).suffix](folder / name, table) for name in names]
            writers = [stack.enter_context(writer) for writer in opened]
            count, selected = 0, select(conn, table)
            while group := list(islice(selected, ROWS_PER_GROUP)):
                count += len(group)
                for write in writers:
                    write(group)
        counts |= dict.fromkeys(names, count)
    return counts


@contextmanager
def _csv(path: Path, table: str) -> Iterator[Callable[[list[TableRow]], None]]:
    columns = bundle_table(table)[1]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        yield lambda group: writer.writerows(
            [csv_cell(row[column.name], column.type) for column in columns] for row in group
        )


class ParquetTable:
    """A Parquet file that rows are added to; each column carries its meaning.

    Used in a `with` statement, which writes the rows that wait at its end.
    """

    def __init__(self, path: Path, columns: Sequence[Column]) -> None:
        self._pa, self._pq = library("pyarrow"), library("pyarrow.parquet")
        pa = self._pa
        kinds = {
            "text": pa.string(), "integer": pa.int64(), "real": pa.float64(), "boolean": pa.bool_(),
        }  # fmt: skip
        self._schema = pa.schema(
            pa.field(
                column.name,
                kinds[column.exported_type],
                column.optional,
                {"description": column.meaning},
            )
            for column in columns
        )
        self._path = path
        self._waiting: list[Mapping[str, object]] = []

    def __enter__(self) -> ParquetTable:
        self._writer = self._pq.ParquetWriter(self._path, self._schema, compression="zstd")
        return self

    def __exit__(self, *error: object) -> None:
        with self._writer:
            if error[0] is None and self._waiting:
                self._write()

    def add(self, rows: Sequence[Mapping[str, object]]) -> None:
        """Add rows; of each the columns of the table."""
        self._waiting += rows
        if len(self._waiting) >= ROWS_PER_GROUP:
            self._write()

    def _write(self) -> None:
        self._writer.write_table(self._pa.Table.from_pylist(self._waiting, schema=self._schema))
        self._waiting = []


@contextmanager
def _parquet(path: Path, table: str) -> Iterator[Callable[[list[TableRow]], None]]:
    with ParquetTable(path, bundle_table(table)[1]) as file:
        yield file.add


_WRITERS = {".csv": _csv, ".parquet": _parquet}
