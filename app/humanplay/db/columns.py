"""The one list of columns, `columns.txt`: what each table has, and where.

From it come the tables of the database with their constraints, the parts of the chain of hashes,
the headers of CSV exports, the tables of a bundle with their dictionary, and the tables of
`docs/data.md` and `docs/release.md`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypedDict

SCHEMA = 1
"""The number of this schema, which stands in the file as `user_version`."""

ColumnType = Literal["text", "integer", "real", "boolean", "bytes"]
Place = Literal["database", "chain", "bundle database", "export", "bundle", "scores"]

_NO_WORDS: Mapping[str, str] = {}
_LETTERS: dict[Place, str] = {
    "database": "Ss", "chain": "S", "bundle database": "d", "export": "x", "bundle": "b", "scores": "c",
}  # fmt: skip
_SQL_TYPES: dict[ColumnType, str] = {
    "text": "TEXT", "integer": "INTEGER", "real": "REAL", "boolean": "INTEGER", "bytes": "BLOB",
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """A column of a table, and what it means (with its unit).

    Attributes:
        where: Letters of the places that it is in (`columns.txt`).
        rule: A constraint of the database (SQL).
        nullable: It may be absent in the database.
        optional: It may be absent elsewhere, too.
        identifies: It says who somebody is, or lets one act for them: it leaves under a
            pseudonym or not at all.
        is_free: A browser had a hand in its text.
    """

    name: str
    type: ColumnType
    where: str
    rule: str
    meaning: str
    nullable: bool
    optional: bool
    identifies: bool
    is_free: bool

    @property
    def references(self) -> tuple[str, str] | None:
        """The table and the column that it refers to; None if it refers to none."""
        match = re.search(r"REFERENCES (\w+)\((\w+)\)", self.rule)
        return None if match is None else (match[1], match[2])

    @property
    def exported_type(self) -> ColumnType:
        """The type outside the database."""
        return "text" if self.type == "bytes" else self.type

    def definition(self) -> str:
        """The column as a table of the database defines it (SQL)."""
        rule = f"IN (0, 1) {self.rule}" if self.type == "boolean" else self.rule
        rule = f"CHECK ({self.name} {rule})" if rule.startswith("IN ") else rule
        return f"{self.name} {_SQL_TYPES[self.type]}{'' if self.nullable else ' NOT NULL'} {rule}"


@dataclass
class Table:
    """A table: what a row of it is, and its columns wherever they are, in order.

    Attributes:
        keys: Columns that together name a row in a bundle.
        rules: Constraints over several columns, indexes are CREATE INDEX statements.
        rowid: False where the key orders the rows.
    """

    name: str
    summary: str
    all: list[Column] = field(default_factory=list)
    keys: tuple[str, ...] = ()
    rules: list[str] = field(default_factory=list)
    indexes: list[str] = field(default_factory=list)
    rowid: bool = True

    def columns(self, place: Place, words: Mapping[str, str] = _NO_WORDS) -> tuple[Column, ...]:
        """The columns that it has in a place; none if it is not there.

        Args:
            words: TABLE.COLUMN -> what it means in a world (`humanplay.task.About`).
        """
        columns = [column for column in self.all if set(column.where) & set(_LETTERS[place])]
        for number, column in enumerate(columns if words else ()):
            meaning = words.get(f"{self.name}.{column.name}", column.meaning)
            columns[number] = replace(column, meaning=meaning)
        return tuple(columns)

    def names(self, place: Place = "database") -> tuple[str, ...]:
        """The names of these columns."""
        return tuple(column.name for column in self.columns(place))

    def statements(self, place: Place = "database") -> list[str]:
        """SQL that creates the table and its indexes; none if it is not in that database."""
        if not (definitions := [column.definition() for column in self.columns(place)]):
            return []
        options = "STRICT" if self.rowid else "STRICT, WITHOUT ROWID"
        lines = ", ".join([*definitions, *self.rules])
        return [f"CREATE TABLE {self.name} ({lines}) {options}", *self.indexes]

    def insert(self, place: Place = "database", how: str = "INSERT") -> str:
        """SQL that adds a row, its values in the order of the columns."""
        names = self.names(place)
        return f"{how} INTO {self.name} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})"

    def references(self) -> dict[str, tuple[str, str]]:
        """Column -> the table and the column that it refers to, in the database."""
        targets = {column.name: column.references for column in self.columns("database")}
        return {name: target for name, target in targets.items() if target is not None}


def _read(text: str) -> dict[str, Table]:
    tables: dict[str, Table] = {}
    for line in text.splitlines():
        first, _, rest = line.partition(" ")
        if first.startswith("["):
            table = tables[first[1:-1]] = Table(first[1:-1], rest)
        elif first == "constraint":
            table.rules.append(rest)
        elif first == "index":
            table.indexes.append(f"CREATE INDEX {rest}")
        elif first == "unique":
            table.indexes.append(f"CREATE UNIQUE INDEX {rest}")
        elif first == "keyed":
            table.keys = tuple(rest.split()[1:])
        elif line == "without rowid":
            table.rowid = False
        elif line and first != "#":
            table.all.append(_column(line))
    return tables


def _column(line: str) -> Column:
    name, kind, *rest = (part.strip() for part in line.split("|", 4))
    type_ = kind.rstrip("?~!*")
    marks = ("?" in kind or "~" in kind, "?" in kind, "!" in kind, "*" in kind)
    return Column(name, type_, *rest, *marks)  # type: ignore[arg-type, call-arg]


TABLES = _read(Path(__file__).with_name("columns.txt").read_text(encoding="utf-8"))
"""Every table by its name, what is referred to before what refers to it."""

BUNDLE_TABLES = (*(name for name, table in TABLES.items() if table.columns("bundle")), "scores")
"""The tables of a bundle; `scores` has fewer columns of the episodes, for a spreadsheet."""


def bundle_table(
    name: str, words: Mapping[str, str] = _NO_WORDS
) -> tuple[Table, tuple[Column, ...]]:
    """The table that a bundle's table is made from, and the bundle's columns in order."""
    table = TABLES["episodes" if name == "scores" else name]
    return table, table.columns("scores" if name == "scores" else "bundle", words)


def summary(name: str) -> str:
    """What a bundle's table holds."""
    return f"one row {bundle_table(name)[0].summary}"


def bundle_reference(table: str, column: str) -> str | None:
    """The table whose key a column of another table of a bundle holds.

    The key has the same name; None if there is none.
    """
    other = {"participant": "participants", "episode": "episodes"}.get(column)
    return None if other == table else other


class ColumnNote(TypedDict):
    """What a bundle's dictionary says of a column."""

    name: str
    type: ColumnType
    meaning: str
    optional: bool


class TableNote(TypedDict):
    """What a bundle's dictionary says of a table."""

    summary: str
    columns: list[ColumnNote]


def check_words(words: Mapping[str, str]) -> None:
    """Raise ValueError if a world has words for a column that there is not."""
    names = {f"{table.name}.{column.name}" for table in TABLES.values() for column in table.all}
    for name in words:
        if name not in names:
            raise ValueError(f"About.columns: expected TABLE.COLUMN of a data set, got {name!r}")


def dictionary(words: Mapping[str, str]) -> dict[str, TableNote]:
    """The column dictionary of a bundle, by table."""
    return {
        table: {
            "summary": summary(table),
            "columns": [
                {
                    "name": column.name,
                    "type": column.exported_type,
                    "meaning": column.meaning,
                    "optional": column.optional,
                }
                for column in bundle_table(table, words)[1]
            ],
        }
        for table in BUNDLE_TABLES
    }


def markdown(columns: tuple[Column, ...]) -> str:
    """Columns as a Markdown table, as documents and datasheets print them."""
    lines = ["|column|type|meaning|", "|---|---|---|"]
    for column in columns:
        kind = f"{column.exported_type}, optional" if column.optional else column.exported_type
        lines.append(f"|`{column.name}`|{kind}|{column.meaning}|")
    return "\n".join(lines)


def markdown_tables() -> str:
    """The tables of the database as a Markdown table."""
    lines = [f"|`{table.name}`|{table.summary}|" for table in TABLES.values() if table.names()]
    return "\n".join(["|table|a row is|", "|---|---|", *lines])
