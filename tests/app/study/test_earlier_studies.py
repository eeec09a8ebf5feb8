"""Studies that earlier code froze and played: they load, and their participants go on where they stood."""

import sqlite3
from contextlib import closing

import pytest
from itsdangerous import Signer

from app.storage.reader import Reader
from app.study.data import load, trial_records
from app.study.folder import Folder
from marsexplorer.episode import replay
from tests.support import earlier
from tests.support.study import Person


@pytest.fixture
def studies(tmp_path):
    return earlier.studies(tmp_path)


def ask(path, sql, *values):
    with closing(sqlite3.connect(path)) as conn:
        return conn.execute(sql, values).fetchall()


def test_the_frozen_protocols_and_their_seeds_still_hold(studies):
    folder = Folder(studies)
    assert folder.names() == ["dunes", "pilot"]
    pilot, dunes = folder.study("pilot"), folder.study("dunes")
    assert (pilot.is_open, dunes.is_open) == (True, False)
    for study, path in (
        (dunes, studies / "studies-play.db"),
        (pilot, earlier.FIXTURES / "databases" / "schema-4.db"),
    ):
        sql = "SELECT DISTINCT x.terrain, e.seed FROM study_episodes x JOIN episodes e ON e.id = x.episode_id WHERE phase = ?"
        for phase, label in (("ranked", "ranked"), ("warm_up", "warm-up")):
            played = ask(path, sql, phase)
            assert played
            assert {terrain: study.seed(label, terrain) for terrain, _ in played} == dict(played)


def test_an_earlier_studys_participants_and_episodes_are_read_as_they_were(studies):
    path = studies / "studies-play.db"
    data = load(path, "dunes")
    people, trials = "SELECT count(*) FROM participants", "SELECT count(*) FROM study_episodes"
    assert [(len(data.people),), (len(data.trials),)] == [*ask(path, people), *ask(path, trials)]
    assert data.secret == Folder(studies).study("dunes").secret.hex()
    with closing(Reader.open(path)) as reader:
        for trial, record in trial_records(reader, data.trials):
            episode = replay(record)
            assert (episode.outcome, episode.steps, episode.score) == (
                trial.outcome,
                trial.steps,
                trial.score,
            )


@pytest.mark.parametrize("schema", [3, 4, 5])
def test_a_participant_of_an_earlier_database_plays_on_to_the_end(studies, tmp_path, serve, schema):
    path, _ = earlier.database(schema, tmp_path)
    sql = """SELECT p.player_id, e.id, (SELECT count(*) FROM steps WHERE episode_id = e.id) FROM participants p
        JOIN study_episodes x ON x.participant_id = p.id JOIN episodes e ON e.id = x.episode_id
        WHERE e.ended_ms IS NULL AND x.phase = 'ranked' AND p.stage = 'ranked'"""
    ((player, episode, steps),) = ask(path, sql)
    ((secret,),) = ask(path, "SELECT value FROM meta WHERE name = 'secret'")
    server = serve(database=path, studies=studies)
    cookies = {"mars_player": Signer(secret, salt="mars-player").sign(player).decode()}
    person = Person(server, "pilot", client=server.client(cookies=cookies), joins=False)
    where = person.me()
    assert (where["stage"], person.frame["episode"], person.frame["step"]) == (
        "ranked",
        episode,
        steps,
    )
    assert (where["ranked"], person.frame["score"]) == ({"done": 2, "of": 3}, None)
    person.play()
    assert person.me()["stage"] == "debrief"
    assert len(person.where["debrief"]["episodes"]) == 3
    person.call("advance", {"from": "debrief"})
    assert person.where["stage"] == "complete"
    newcomer = Person(server, "pilot", outside_ids={"PROLIFIC_PID": "somebody-new"})
    assert newcomer.where["stage"] == "consent"
    refused = Person(server, "pilot", joins=False).refused(
        "join", {"outside_ids": {"PROLIFIC_PID": "outside-0"}}
    )
    assert refused.startswith("someone has joined with this PROLIFIC_PID")
