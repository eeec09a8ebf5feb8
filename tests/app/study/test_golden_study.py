"""The golden study: its protocol, seeds and episodes are what they were when it was played."""

import sqlite3
from contextlib import closing

import pytest

from app.storage.reader import Reader
from app.study.data import load, trial_records
from app.study.folder import Folder
from marsexplorer.episode import replay
from tests.support import golden


@pytest.fixture
def studies(tmp_path):
    return golden.studies(tmp_path)


def ask(path, sql, *values):
    with closing(sqlite3.connect(path)) as conn:
        return conn.execute(sql, values).fetchall()


def test_the_frozen_protocol_and_its_seeds_still_hold(studies):
    study = Folder(studies).study("dunes")
    assert not study.is_open
    sql = "SELECT DISTINCT x.terrain, e.seed FROM study_episodes x JOIN episodes e ON e.id = x.episode_id WHERE phase = ?"
    for phase, label in (("ranked", "ranked"), ("warm_up", "warm-up")):
        played = ask(studies / "studies-play.db", sql, phase)
        assert played
        assert {terrain: study.seed(label, terrain) for terrain, _ in played} == dict(played)


def test_the_participants_and_episodes_are_read_as_they_were(studies):
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
