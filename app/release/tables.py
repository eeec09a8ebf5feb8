"""The tables of a release, written from its own database as Parquet, JSON Lines and CSV; each episode is replayed."""

from __future__ import annotations

import csv
import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from app.release.columns import EPISODE_TABLE, INPUT_EVENT_TABLE, SCORE_TABLE, STEP_TABLE, Column
from app.release.errors import library
from app.storage.connection import rows
from app.storage.reader import config_of, record_of
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Episode, replay
from marsexplorer.score import steps_to_target

TableRow = dict[str, Any]
_RELEASED_EPISODES = """SELECT e.*, s.phase, s.trial, s.terrain AS terrain_index, p.id AS participant, p.kind, p.script
    FROM episodes e JOIN study_episodes s ON s.episode_id = e.id JOIN participants p ON p.id = s.participant_id
    ORDER BY e.started_ms, e.id"""
ROWS_PER_GROUP = 20_000
"""The rows of one group in a Parquet file."""


@dataclass(frozen=True)
class ReleasedEpisode:
    """One episode of a release: its rows as the tables hold them, and its replay."""

    header: TableRow
    steps: list[TableRow]
    events: list[TableRow]
    episode: Episode

    @property
    def actions(self) -> list[str]:
        """The moves in words."""
        return [ACTIONS[action] for action in self.episode.actions]


def released_episodes(conn: sqlite3.Connection) -> Iterator[ReleasedEpisode]:
    """Return every episode of a release's database, oldest first."""
    for row in rows(conn, _RELEASED_EPISODES):
        steps = rows(conn, "SELECT * FROM steps WHERE episode_id = ? ORDER BY step", row["id"])
        events = rows(conn, "SELECT * FROM input_events WHERE episode_id = ? ORDER BY number", row["id"])
        episode = replay(record_of(row, steps))
        header = _header(row)
        who = {"participant": row["participant"], "episode": row["id"]}
        yield ReleasedEpisode(header, _steps(who, steps, episode), [{**who, **_event(event)} for event in events], episode)


def _header(row: TableRow) -> TableRow:
    config = config_of(row)
    made = {
        **row,
        **{name: getattr(config, name) for name in ("level", "rows", "cols", "sensor_radius", "beta", "max_steps")},
        "episode": row["id"],
        "terrain": row["terrain"].hex(),
        "coverage": row["discovered"] / config.n,
        "return": row["total"],
        "steps_to_99": steps_to_target(config, row["outcome"], row["steps"]),
    }
    return {column.name: made[column.name] for column in EPISODE_TABLE}


def _steps(who: TableRow, steps: list[TableRow], episode: Episode) -> list[TableRow]:
    found = []
    for here, step in enumerate(steps, 1):
        row, col = episode.path[here]
        derived = {"action": ACTIONS[step["action"]], "row": row, "col": col, "coverage": step["discovered"] / episode.config.n}
        made = {**who, **step, **derived}
        found.append({column.name: made[column.name] for column in STEP_TABLE})
    return found


def _event(event: TableRow) -> TableRow:
    made = {**event, "event": event["kind"]}
    for name in ("repeat", "trusted"):
        made[name] = None if event[name] is None else bool(event[name])
    return {column.name: made[column.name] for column in INPUT_EVENT_TABLE if column.name in made}


class TableWriters:
    """Every table file of a release: `with TableWriters(folder) as write: write(episode)`, one episode after another."""

    def __init__(self, folder: Path) -> None:
        self._stack = ExitStack()
        self._add: list[Callable[[ReleasedEpisode], None]] = []
        self._folder = folder
        self.rows: dict[str, int] = {}

    def __enter__(self) -> TableWriters:
        folder = self._folder
        (folder / "parquet").mkdir()
        kinds: tuple[tuple[str, tuple[Column, ...], Callable[[ReleasedEpisode], list[TableRow]]], ...] = (
            ("parquet/episodes.parquet", EPISODE_TABLE, lambda each: [each.header]),
            ("parquet/steps.parquet", STEP_TABLE, lambda each: each.steps),
            ("parquet/input_events.parquet", INPUT_EVENT_TABLE, lambda each: each.events),
        )
        for name, columns, rows_of in kinds:
            self._parquet(name, columns, rows_of)
        self._json_lines("episodes.jsonl")
        self._scores("scores.csv")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stack.__exit__(kind, error, trace)

    def __call__(self, each: ReleasedEpisode) -> None:
        """Write one episode to every file."""
        for add in self._add:
            add(each)

    def _parquet(self, name: str, columns: tuple[Column, ...], rows_of: Callable[[ReleasedEpisode], list[TableRow]]) -> None:
        table = ParquetTable(self._folder / name, columns)
        self._stack.callback(table.close)
        self.rows[name] = 0

        def add(each: ReleasedEpisode) -> None:
            found = rows_of(each)
            table.add(found)
            self.rows[name] += len(found)

        self._add.append(add)

    def _json_lines(self, name: str) -> None:
        file = self._stack.enter_context((self._folder / name).open("w", encoding="utf-8"))
        self.rows[name] = 0

        def add(each: ReleasedEpisode) -> None:
            file.write(json.dumps({**each.header, "actions": each.actions}, ensure_ascii=False) + "\n")
            self.rows[name] += 1

        self._add.append(add)

    def _scores(self, name: str) -> None:
        file = self._stack.enter_context((self._folder / name).open("w", encoding="utf-8", newline=""))
        table = csv.DictWriter(file, [column.name for column in SCORE_TABLE], extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        self.rows[name] = 0

        def add(each: ReleasedEpisode) -> None:
            table.writerow(each.header)
            self.rows[name] += 1

        self._add.append(add)


class ParquetTable:
    """A Parquet file that rows are added to; each column carries its meaning."""

    def __init__(self, path: Path, columns: tuple[Column, ...]) -> None:
        pa, pq = library("pyarrow"), library("pyarrow.parquet")
        kinds = {"text": pa.string(), "integer": pa.int64(), "real": pa.float64(), "boolean": pa.bool_()}
        fields = [
            pa.field(column.name, kinds[column.type], column.optional, {"description": column.meaning}) for column in columns
        ]
        self._make = pa.Table.from_pylist
        self._schema = pa.schema(fields)
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")
        self._waiting: list[TableRow] = []

    def add(self, found: list[TableRow]) -> None:
        """Add rows; they are written ROWS_PER_GROUP at a time."""
        self._waiting += found
        if len(self._waiting) >= ROWS_PER_GROUP:
            self._flush()

    def close(self) -> None:
        """Write what is still waiting, and close the file."""
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        if self._waiting:
            self._writer.write_table(self._make(self._waiting, schema=self._schema))
            self._waiting = []
