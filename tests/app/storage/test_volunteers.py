"""The volunteers' sums are those of their episodes, or `verify` finds it."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.db.backup import back_up, restore
from humanplay.db.database import reading
from humanplay.db.erasure import forget
from humanplay.db.merging import merge
from humanplay.db.reader import Reader
from humanplay.db.store import Store
from humanplay.db.volunteers import differences
from humanplay.report.statistics.human_level import human_level
from humanplay.study.verification import verify_database
from marsexplorer.config import EnvConfig
from tests.support.recorded import SMALL, add_session, add_steps, open_episode, play, tour
from tests.support.recorded_daily import play_daily
from tests.support.stored_studies import freeze, play_study

WIDE = EnvConfig("1-1-1", 7, 9, sensor_radius=2)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Players with three and one episodes, a participant's two, and uncounted ones."""
    folder = tmp_path_factory.mktemp("recorded")
    path = folder / "play.db"
    people = play_study(path, freeze(folder / "studies"), ("human", "human"))
    with closing(Store(path)) as store:
        (participant,) = store.query(
            "SELECT player_id AS id FROM participants WHERE id = ?", [people[0]]
        )
        for seed, player in enumerate(("ada", "ada", "bob", participant["id"])):
            play(store, seed, player, explore=seed != 1)
        for seed, player in enumerate(("ada", participant["id"])):
            play(store, seed, player, config=WIDE)
        play(store, 8, "ada", driver="script")
        play_daily(store, "ada")
    return path, people[0]


@pytest.fixture
def path(recorded, tmp_path):
    """A copy of them, and the participant."""
    return Path(shutil.copy(recorded[0], tmp_path / "play.db")), recorded[1]


def played(path):
    """Return each figure's episodes and spoilt ones by size, checked by the episodes."""
    with reading(path) as conn:
        assert list(differences(conn)) == []
    with closing(Reader.open(path)) as reader:
        figures = human_level(reader)["figures"]
        rows = [(row["config_hash"], row["attestation"]) for row in reader.finished("human")]
    for figure in figures:
        levels = [level for config, level in rows if config == figure["config_hash"]]
        assert (figure["episodes"], figure["spoilt"]) == (len(levels), levels.count("spoilt"))
    assert sum(figure["episodes"] for figure in figures) == len(rows)
    return {figure["rows"]: (figure["episodes"], figure["spoilt"]) for figure in figures}


def test_sums_are_those_of_the_episodes_after_each_level_erasure_merge_and_restoring(
    path, tmp_path
):
    path, person = path
    assert verify_database(path).findings == ()
    assert played(path) == {SMALL.rows: (4, 0), WIDE.rows: (2, 0)}
    back_up(path, tmp_path / "copy.db")
    with closing(Store(path)) as store:
        for seed, level in enumerate(("unattested", "spoilt", "attested", "supervised")):
            row, episode = open_episode(store, add_session(store, "bob"), 20 + seed)
            add_steps(store, row, episode, tour(episode), level=level)
    assert played(path) == {SMALL.rows: (7, 1), WIDE.rows: (2, 0)}
    forget(path, person)
    assert played(path) == {SMALL.rows: (6, 1), WIDE.rows: (1, 0)}
    with closing(Store(tmp_path / "other.db")) as store:
        play(store, 30, "cid", explore=True)
    merge([path, tmp_path / "other.db", tmp_path / "copy.db"], tmp_path / "all.db")
    assert played(tmp_path / "all.db") == {SMALL.rows: (7, 1), WIDE.rows: (1, 0)}
    restore(tmp_path / "copy.db", path, "now")
    assert played(path) == {SMALL.rows: (4, 0), WIDE.rows: (2, 0)}


def test_sums_hold_an_episode_whose_end_was_told_when_the_server_was_killed(spawn, tmp_path):
    server = spawn()
    client = server.page()
    for number in (1, 2):
        begun = client.post("/api/sessions", json={"size": 5}).json()
        assert server.explore(client, begun["session"])["outcome"] == "explored"
        if number == 1:
            assert client.get("/api/human-level").json()["figures"][0]["episodes"] == 1
    server.kill()
    ((episodes, _),) = played(tmp_path / "playground.db").values()  # at a machine's speed: spoilt
    assert episodes == 2


@pytest.mark.parametrize(
    "harm",
    [
        *(
            f"UPDATE volunteers SET {column} = {column} + 1 WHERE player_id = 'ada'"
            for column in ("episodes", "abandoned", "spoilt", "failed", "score", "steps", "played_score", "played_steps")
        ),
        "UPDATE volunteers SET player_id = 'eve' WHERE player_id = 'ada'",
        "UPDATE volunteers SET config_hash = 'x' || config_hash WHERE player_id = 'ada'",
        "DELETE FROM volunteers WHERE player_id = 'ada'",
        "DELETE FROM volunteer_figures",
        "UPDATE volunteer_figures SET config = '{}'",
        "UPDATE volunteer_figures SET task = 'chess'",
    ],
)  # fmt: skip
def test_sums_that_are_not_those_of_the_episodes_are_found_and_a_merge_makes_them_anew(
    path, tmp_path, harm
):
    path, _ = path
    with closing(sqlite3.connect(path, isolation_level=None)) as conn:
        conn.execute("INSERT INTO players VALUES ('eve', 0)")
        conn.execute(harm)
    findings = verify_database(path).findings
    assert findings
    assert all(finding.where.startswith("volunteers' figure ") for finding in findings)
    merge([path], tmp_path / "anew.db")
    assert played(tmp_path / "anew.db") == {SMALL.rows: (4, 0), WIDE.rows: (2, 0)}
