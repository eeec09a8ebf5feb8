"""Finished episodes as CSV, replayed before they are written.

A row is an episode or a step. Columns are listed in `docs/data.md`. `verified` is false if the
replay differs from what is stored: such rows are marked, never hidden. Players appear under
pseudonyms drawn anew for every export; sessions do not appear.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import hmac
import io
import json
import os
import secrets
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Literal
from zipfile import ZIP_DEFLATED, ZipFile

from humanplay.db.chain import append_marks, export_of
from humanplay.db.columns import TABLES, Column, ColumnType, markdown
from humanplay.db.database import writing
from humanplay.db.reader import Reader, Who
from humanplay.db.resimulation import simulate
from humanplay.db.rows import CountedEpisode, MoveRow
from humanplay.db.trial import Trial
from humanplay.task import counted
from marsexplorer.files import to_cell, write_whole

ExportTable = Literal["episodes", "steps"]
Row = dict[str, object]
Keep = Callable[[ExportTable, Sequence[Row]], None]
COLUMNS: dict[ExportTable, tuple[str, ...]] = {
    "episodes": TABLES["episodes"].names("export"),
    "steps": TABLES["steps"].names("export"),
}
_DERIVED = tuple(
    name
    for name in COLUMNS["episodes"]
    if name not in TABLES["episodes"].names() and isinstance(getattr(Trial, name, None), property)
)
"""Columns of episodes that no table holds: what a `Trial` says of itself under their names."""


def new_key() -> bytes:
    """A key for one export's pseudonyms; use one for both tables so that they agree."""
    return secrets.token_bytes(32)


def export_table(
    source: Reader | Path | str,
    table: ExportTable,
    who: Who = "all",
    key: bytes | None = None,
    public: bool = False,
    at_ms: int | None = None,
    player: str | None = None,
) -> Generator[bytes]:
    """Yield the table in pieces, the header first, one piece an episode.

    Args:
        source: The database's path, or a Reader or Store on it; read over a read-only
            connection of its own.
        who: "all", or "human" for the episodes that count.
        public: True leaves out the episodes of studies that are not closed, and of days that
            are not over.
        at_ms: When a public export is made (None: now).
        player: What they drove alone.
    """
    _check(table, who)
    path = source.path if isinstance(source, Reader) else source
    rows = _stream(Reader.open(path, public, at_ms), table, who, player, key or new_key())
    return _encoded_pieces(rows, table)


def write_table(
    path: Path,
    most_bytes: int,
    database: Path,
    table: ExportTable,
    who: Who,
    player: str | None,
    at_ms: int,
) -> None:
    """Write what `export_table` yields of what anybody may see.

    Raises:
        OSError: If it takes more than `most_bytes`.
    """
    pieces = export_table(database, table, who, None, True, at_ms, player)
    with closing(pieces), path.open("xb") as file:
        for piece in pieces:
            if file.tell() + len(piece) > most_bytes:
                raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
            file.write(piece)


def write_human_scores(path: Path, most_bytes: int, database: Path, at_ms: int) -> None:
    """Write a ZIP of people's episodes that count, as anybody may see them.

    It holds both tables and a datasheet.

    Raises:
        OSError: If it takes more than `most_bytes`.
    """
    key = new_key()
    lines: dict[str, int] = {}
    with path.open("xb") as file, ZipFile(file, "w", ZIP_DEFLATED) as bundle:
        for table in COLUMNS:
            pieces = export_table(database, table, "human", key, True, at_ms)
            with closing(pieces), bundle.open(f"{table}.csv", "w", force_zip64=True) as out:
                lines[table] = -1  # the head is no row
                for piece in pieces:
                    if file.tell() + len(piece) > most_bytes:
                        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
                    lines[table] += piece.count(b"\n")
                    out.write(piece)
        bundle.writestr("DATASHEET.md", _datasheet(lines, at_ms))
        bundle.writestr(SCHEMA_FILE, table_schema())


def _datasheet(lines: Mapping[str, int], at_ms: int) -> str:
    day = datetime.fromtimestamp(at_ms / 1000, UTC).date().isoformat()
    tables = (f"## {name}.csv\n\n{markdown(TABLES[name].columns('export'))}\n" for name in COLUMNS)
    episodes, moves = counted(lines["episodes"], "episode"), counted(lines["steps"], "move")
    return DATASHEET.format(
        day=day,
        version=version("humanplay"),
        episodes=episodes,
        moves=moves,
        tables="\n".join(tables),
    )


DATASHEET = """\
# Human scores: datasheet

Exported on {day} by version {version} of the playground: {episodes}, {moves}.

- **Why**: to say how well people explore, beside policies on the same terrains.
- **What a row is**: `episodes.csv` has an episode that counts, `steps.csv` a move of one, joined by `episode`.
- **What counts**: ranked episodes of people, alone, on terrains that were neither chosen nor met before, whose moves all fit
  key presses or touches of the page; one that was left counts, as abandoned. Practice, scripts, policies and challenges never
  enter. Episodes of open studies and of days that are not over are left out.
- **Who**: volunteers of a playground, who chose to play and how often. They stand for nobody but themselves, and their mean is
  no human level, which is a closed study's figure. Nothing is known of them; a pseudonym is drawn anew for each export.
- **How it was checked**: each episode was replayed; `verified` is false where the replay does not come to what is stored,
  or nothing steps the environment again.
- **A figure**: the mean over players of each player's mean `steps_to_target` or `score`, with an interval over players.
- **Licence**: that of the server's operator; ask them where none is stated.

{tables}"""
"""After Gebru et al. 2021, "Datasheets for Datasets"."""


SCHEMA_FILE = "datapackage.json"
"""What lies beside the tables of an export and says of which type each column is."""
_SCHEMA_TYPES: dict[ColumnType, str] = {
    "text": "string", "integer": "integer", "real": "number", "boolean": "boolean",
}  # fmt: skip


def table_schema() -> str:
    """The types and meanings of all columns, as a Data Package of two tables (JSON)."""
    resources = [
        {
            "name": table,
            "path": f"{table}.csv",
            "schema": {
                "fields": [
                    {
                        "name": column.name,
                        "type": _SCHEMA_TYPES[column.exported_type],
                        "description": column.meaning,
                        # a text may be empty, which a table cannot tell from absent
                        "constraints": {
                            "required": not column.optional and column.exported_type != "text"
                        },
                    }
                    for column in TABLES[table].columns("export")
                ],
                "missingValues": [""],
            },
        }
        for table in COLUMNS
    ]
    return json.dumps({"resources": resources}, indent=2, ensure_ascii=False) + "\n"


def export_to(
    database: Path,
    folder: Path,
    who: Who,
    advance: Callable[[int, int], None],
    open_studies: bool = False,
    keep: Keep | None = None,
) -> str:
    """Write `episodes.csv`, `steps.csv` and their schema: all of them or none.

    Args:
        advance: Called with (episodes written, episodes in all), both tables counted.
        open_studies: Take in those of open studies, and note it in the chain of the database.
        keep: Called with the rows of each episode, for a table of another form.

    Returns:
        A sentence on what was written.
    """
    with closing(Reader.open(database, open_studies=open_studies)) as reader:
        total, studies = 2 * reader.count(who), reader.open_studies()
    folder.mkdir(parents=True, exist_ok=True)
    secret = [study.name for study in studies if study.secret_kept_ms is not None]
    running = [study for study in studies if study.secret_kept_ms is None]
    if open_studies and running:
        with writing(database) as conn:  # before anything of them is written
            append_marks(conn, map(export_of, running))
    paths = [folder / f"{table}.csv" for table in COLUMNS]
    key, done, lines, unverified = new_key(), 0, [0, 0], 0
    with (
        write_whole(paths[0]) as episodes,
        write_whole(paths[1]) as steps,
        write_whole(folder / SCHEMA_FILE) as schema,
    ):
        for number, (table, file) in enumerate(zip(COLUMNS, (episodes, steps), strict=True)):
            file.write(_head(table))
            reader = Reader.open(database, open_studies=open_studies)
            for rows in _stream(reader, table, who, None, key):
                file.write(_encoded(rows, TABLES[table].columns("export")))
                if keep is not None:
                    keep(table, rows)
                done += 1
                lines[number] += len(rows)
                unverified += number == 0 and not rows[0]["verified"]
                advance(min(done, total), total)
        schema.write(table_schema().encode())
    count, moves = lines
    warning = ""
    if unverified:
        warning = f"; {unverified} of them did not replay as recorded, or cannot be played again: see the column verified"
    if secret:
        warning += f"; left out, since their secrets are kept: {', '.join(secret)}"
    names = ", ".join(study.name for study in running)
    if running and open_studies:
        warning += f"; taken in although open, which the chain and their reports say: {names}"
    elif running:
        warning += f"; left out, since they are open: {names} (--open-studies takes them in)"
    return f"{counted(count, 'episode')} in {paths[0]}, {counted(moves, 'step')} in {paths[1]}{warning}"


def _check(table: str, who: str) -> None:
    """Raise ValueError if there is no such table or choice of episodes."""
    choices = (("table", table, tuple(COLUMNS)), ("who", who, ("all", "human")))
    for name, chosen, allowed in choices:
        if chosen not in allowed:
            raise ValueError(f"{name} must be one of {', '.join(allowed)}, got {chosen!r}")


def _head(table: ExportTable) -> bytes:
    return (",".join(COLUMNS[table]) + "\n").encode()


def _encoded_pieces(pieces: Generator[list[Row]], table: ExportTable) -> Generator[bytes]:
    """The rows as CSV, the header first."""
    with closing(pieces):
        yield _head(table)
        for rows in pieces:
            yield _encoded(rows, TABLES[table].columns("export"))


def _stream(
    reader: Reader, table: ExportTable, who: Who, player: str | None, key: bytes
) -> Generator[list[Row]]:
    """Yield the table's rows, an episode's at a time, and close the reader."""
    try:
        with reader.snapshot():
            for row in reader.finished(who, player):
                if rows := _rows_of(row, reader.steps(row["id"]), table, key):
                    yield rows
    finally:
        reader.close()


def _rows_of(
    row: CountedEpisode, steps: list[MoveRow], table: ExportTable, key: bytes
) -> list[dict[str, object]]:
    """What the export says of an episode, by column: one row, or one a step."""
    episode, findings = simulate(row, steps)
    trial = Trial.of(row)
    actions = trial.environment.actions
    player = _pseudonym(trial.owner_id, key)
    common = {"episode": trial.id, "player": player, "verified": not findings}
    if table == "episodes":
        return [
            {
                **trial.config.to_dict(),
                **row,
                **common,
                "terrain": f"x{trial.terrain.hex()}" if trial.terrain else "",
                **{name: getattr(trial, name) for name in _DERIVED},
                "return": trial.total,
                "daily": trial.day,
                "actions": " ".join(actions[step["action"]] for step in steps),
            }
        ]
    return [
        {
            **step,
            **common,
            "action": actions[step["action"]],
            **(episode.place(step["step"] + 1) if episode else {}),
        }
        for step in steps
    ]


def _encoded(rows: list[dict[str, object]], columns: Sequence[Column]) -> bytes:
    out = io.StringIO()
    lines = ([csv_cell(row.get(column.name), column.type) for column in columns] for row in rows)
    csv.writer(out, lineterminator="\n").writerows(lines)
    return out.getvalue().encode()


def csv_cell(content: object, kind: ColumnType) -> object:
    """A CSV cell: truth values are true and false, what is absent is empty."""
    if kind == "boolean" and content is not None:
        return "true" if content else "false"
    return to_cell(content)


def _pseudonym(player_id: str | None, key: bytes) -> str | None:
    if player_id is None:
        return None
    return "P" + hmac.new(key, player_id.encode(), hashlib.sha256).hexdigest()[:10]
