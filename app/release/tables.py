"""The tables of a release, written from its own database by the queries of `queries.sql`: Parquet and CSV."""

from __future__ import annotations

import csv
import re
import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

from app.release.columns import BUNDLE_COLUMNS, Column
from app.release.errors import library
from app.storage.database import rows, stream
from app.storage.reader import record_of
from marsexplorer.episode import Episode, replay
from marsexplorer.files import to_cell

QUERIES = Path(__file__).with_name("queries.sql")
TableRow = dict[str, Any]
ROWS_PER_GROUP = 20_000
"""The rows of one group in a Parquet file."""

PARQUET = (
    "participants",
    "episodes",
    "steps",
    "input_events",
    "policy_episodes",
    "move_regrets",
    "move_agreements",
)
"""The tables that are Parquet files; every table is a CSV file."""


@cache
def queries() -> dict[str, str]:
    """Return table -> its SELECT."""
    parts = re.split(r"^-- table: (\w+)$", QUERIES.read_text(encoding="utf-8"), flags=re.M)
    return {
        name: text.strip().removesuffix(";")
        for name, text in zip(parts[1::2], parts[2::2], strict=True)
    }


def select(conn: sqlite3.Connection, table: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table from a bundle's database, columns in their order and truth values as such."""
    columns = BUNDLE_COLUMNS[table]
    truths = [column.name for column in columns if column.type == "boolean"]
    for row in stream(conn, queries()[table]):
        for name in truths:
            row[name] = None if row[name] is None else bool(row[name])
        yield {column.name: row[column.name] for column in columns}


@dataclass(frozen=True)
class ReleasedEpisode:
    """One episode of a release: its row of the table of episodes, and its replay."""

    header: TableRow
    episode: Episode


def released_episodes(conn: sqlite3.Connection) -> Iterator[ReleasedEpisode]:
    """Return every episode of a release's database, oldest first."""
    for header in select(conn, "episodes"):
        (row,) = rows(conn, "SELECT * FROM episodes WHERE id = ?", header["episode"])
        steps = rows(
            conn, "SELECT * FROM steps WHERE episode_id = ? ORDER BY step", header["episode"]
        )
        yield ReleasedEpisode(header, replay(record_of(row, steps)))


def write_tables(folder: Path, conn: sqlite3.Connection) -> dict[str, int]:
    """Write every table of a release, as CSV and all but `scores` as Parquet; return the rows by file."""
    (folder / "parquet").mkdir()
    (folder / "csv").mkdir()
    found: dict[str, int] = {}
    for table in BUNDLE_COLUMNS:
        names = [f"csv/{table}.csv", *([f"parquet/{table}.parquet"] if table in PARQUET else [])]
        found |= _write_table(folder, conn, table, names)
    return found


def _write_table(
    folder: Path, conn: sqlite3.Connection, table: str, names: Iterable[str]
) -> dict[str, int]:
    kinds: dict[str, Callable[[Path, tuple[Column, ...]], TableFile]]
    kinds = {".parquet": ParquetTable, ".csv": CsvTable}
    count = 0
    with ExitStack() as stack:
        opened = (kinds[Path(name).suffix](folder / name, BUNDLE_COLUMNS[table]) for name in names)
        writers = [stack.enter_context(each) for each in opened]
        for row in select(conn, table):
            count += 1
            for writer in writers:
                writer.add(row)
    return dict.fromkeys(names, count)


class TableFile(ABC):
    """A file that rows are added to; open it with `with`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @abstractmethod
    def add(self, row: TableRow) -> None:
        """Add a row."""

    @abstractmethod
    def close(self) -> None:
        """Write what is still waiting, and close the file."""


class CsvTable(TableFile):
    """A CSV file with a header; what is absent is empty, truth values are true and false."""

    def __init__(self, path: Path, columns: tuple[Column, ...]) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._table = csv.DictWriter(
            self._file, [column.name for column in columns], lineterminator="\n"
        )
        self._table.writeheader()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def add(self, row: TableRow) -> None:
        """Write a row."""
        self._table.writerow(
            {
                name: str(value).lower() if isinstance(value, bool) else to_cell(value)
                for name, value in row.items()
            }
        )


class ParquetTable(TableFile):
    """A Parquet file; each column carries its meaning, and rows are written ROWS_PER_GROUP at a time."""

    def __init__(self, path: Path, columns: tuple[Column, ...]) -> None:
        pa, pq = library("pyarrow"), library("pyarrow.parquet")
        kinds = {
            "text": pa.string(),
            "integer": pa.int64(),
            "real": pa.float64(),
            "boolean": pa.bool_(),
        }
        fields = [
            pa.field(
                column.name, kinds[column.type], column.optional, {"description": column.meaning}
            )
            for column in columns
        ]
        self._make = pa.Table.from_pylist
        self._schema = pa.schema(fields)
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")
        self._waiting: list[TableRow] = []

    def close(self) -> None:
        """Write what is still waiting, and close the file."""
        self._flush()
        self._writer.close()

    def add(self, row: TableRow) -> None:
        """Add a row, which is written with others."""
        self._waiting.append(row)
        if len(self._waiting) >= ROWS_PER_GROUP:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            self._writer.write_table(self._make(self._waiting, schema=self._schema))
            self._waiting = []
