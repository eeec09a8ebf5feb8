"""The one list of columns, as the database and the documents have it."""

import sqlite3
from contextlib import closing

from humanplay.db.columns import TABLES
from humanplay.db.store import Store


def test_a_new_database_has_the_tables_and_columns_of_the_list_and_no_others(tmp_path):
    Store(tmp_path / "play.db").close()
    with closing(sqlite3.connect(tmp_path / "play.db")) as conn:
        sql = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
        tables = {
            name: tuple(row[1] for row in conn.execute(f"PRAGMA table_info({name})"))
            for (name,) in conn.execute(sql)
        }
    assert tables == {name: table.names() for name, table in TABLES.items() if table.names()}


def test_nothing_that_says_who_somebody_is_leaves_as_it_is():
    for table in TABLES.values():
        for column in table.all:
            leaves = set(column.where) & set("xbc")
            assert not (column.identifies and leaves), (table.name, column.name)
            of = column.references and column.references[0]
            assert column.identifies or of not in ("players", "sessions", "participants")


def test_every_column_of_a_chained_table_is_in_the_chain_but_for_what_may_change():
    """A board's pace may change; an erased episode blanks its challenges.

    What an environment raised is for its author alone and counts for nothing; a release blanks it.
    """
    free = {
        (table.name, name)
        for table in TABLES.values()
        if table.names("chain")
        for name in set(table.names()) - set(table.names("chain"))
    }
    changing = ("pace_mode", "moves_per_second", "challenges")
    assert free == {("episodes", "failure"), *(("sessions", name) for name in changing)}
