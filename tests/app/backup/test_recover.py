"""A damaged database read out: nothing that is in the new file is wrong, and what is not there is said."""

import sqlite3
from contextlib import closing

import pytest

from app.backup.recovering import recover
from app.cli.main import main
from app.storage.checks import quick_check
from app.storage.database import StoreError
from app.storage.store import Store
from app.study.verification import verify_database
from tests.support.recorded import SMALL, add_session, add_steps, free_moves, open_episode, play

EPISODES = 60


@pytest.fixture
def database(tmp_path):
    """Finished episodes, and one that runs."""
    with closing(Store(tmp_path / "play.db")) as store:
        for seed in range(EPISODES):
            play(store, seed=seed, explore=True)
        row, episode = open_episode(store, add_session(store), seed=900, config=SMALL)
        add_steps(store, row, episode, free_moves(episode)[:3])
    return tmp_path / "play.db"


def pages_of(path, table):
    with closing(sqlite3.connect(path)) as db:
        if not db.execute("SELECT 1 FROM pragma_module_list WHERE name = 'dbstat'").fetchone():
            pytest.skip("this SQLite cannot say which page belongs to which table")
        sql = "SELECT pageno FROM dbstat WHERE name = ? AND pagetype = 'leaf' ORDER BY path"
        return [number for (number,) in db.execute(sql, [table])]


def overwrite(path, pages):
    with path.open("r+b") as file:
        for number in pages:
            file.seek(4096 * (number - 1))
            file.write(b"\x77" * 4096)


def count(path, table, where="1"):
    with closing(sqlite3.connect(path)) as db:
        return db.execute(f"SELECT count(*) FROM {table} WHERE {where}").fetchone()[0]


def test_a_whole_database_comes_out_as_it_is(database, tmp_path):
    found = recover(database, tmp_path / "new.db")
    assert (found.broken, found.left_out) == ([], {})
    for table in ("episodes", "steps", "chain", "chain_salts", "sessions", "players", "meta"):
        assert count(tmp_path / "new.db", table) == count(database, table) == found.read[table]
    assert not verify_database(tmp_path / "new.db").findings


@pytest.mark.parametrize("table", ["steps", "episodes", "chain", "sessions"])
def test_one_damaged_page_costs_what_was_on_it_and_no_more(database, tmp_path, table):
    pages = pages_of(database, table)
    overwrite(database, [pages[len(pages) // 2]])
    assert quick_check(database) != "ok"
    before, new = database.read_bytes(), tmp_path / "new.db"
    found = recover(database, new)
    assert found.broken == [table]
    assert quick_check(new) == "ok"
    assert database.read_bytes() == before
    kept = count(new, "episodes", "ended_ms IS NOT NULL")
    assert kept >= (EPISODES * (1 - 2 / len(pages)) if table in ("steps", "episodes") else EPISODES)
    result = verify_database(new)
    assert result.episodes == kept
    wrong = [
        str(each)
        for each in result.findings
        if not any(word in str(each) for word in ("digest", "chain", "salt"))
    ]
    assert wrong == [], "the chain names what is missing; what is there is right"
    assert (found.stand_ins > 0) == (table == "sessions")
    with closing(Store(new)) as store:
        play(store, seed=5_000)


def test_what_has_no_first_page_is_refused_in_one_sentence_and_leaves_nothing(database, tmp_path):
    with database.open("r+b") as file:
        file.seek(100)
        file.write(b"\x77" * 3996)
    with pytest.raises(StoreError, match="a backup is the way"):
        recover(database, tmp_path / "new.db")
    assert not list(tmp_path.glob("new.db*"))


def test_the_command_reports_what_was_lost(database, tmp_path, capsys):
    overwrite(database, pages_of(database, "steps")[1:2])
    with pytest.raises(SystemExit) as left:
        main(["recover", str(database), "--out", str(tmp_path / "new.db")])
    said = capsys.readouterr().out
    assert left.value.code == 0
    assert "pages could not be read of: steps" in said
    assert "left out, since they are not complete" in said
    assert (
        (tmp_path / "new.db.report.txt")
        .read_text()
        .startswith("pages could not be read of: steps\n")
    )
