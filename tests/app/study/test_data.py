"""A study read from a real database, without anything that identifies people."""

import pytest

from humanplay.db.reader import Reader
from humanplay.report.making import load_with_folder
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError
from tests.support.stored_studies import StudyRecorder, freeze, play_study


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    study = freeze(folder / "studies")
    return folder, study, play_study(folder / "play.db", study)


def test_people_and_trials_are_as_they_were_played(place):
    folder, study, people = place
    data = load(folder / "play.db", "dunes")
    assert data.protocol == study.protocol
    assert (data.protocol_hash, data.closed_ms, data.secret) == (
        study.protocol_hash,
        study.closed_ms,
        study.secret.hex(),
    )
    assert {person.id for person in data.people} == set(people)
    assert [person.kind for person in data.people] == ["human", "human", "script"]
    assert data.people[2].script == "noisy-frontier"
    assert [event[1] for event in data.people[0].events] == ["joined", "stage", "answers", "order"]
    assert len(data.trials) == 3 * (1 + 2 + 3)
    first = next(
        trial
        for trial in data.trials
        if (trial.participant, trial.phase, trial.trial) == (people[0], "ranked", 0)
    )
    assert (first.outcome, first.steps, first.steps_to_target) == (
        "abandoned",
        2,
        study.protocol.env_config.limit,
    )
    assert first.seed == study.seed("ranked", first.terrain_index)
    assert data.seeds() == {i: study.seed("ranked", i) for i in range(3)}


def test_a_running_episode_is_a_trial_without_an_end(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    person = recorder.join(0, stage="ranked")
    recorder.play(person, "ranked", 0, "open")
    recorder.close()
    data = load(tmp_path / "play.db", "dunes")
    (trial,) = data.trials
    assert (trial.ended_ms, trial.outcome, trial.steps_to_target, trial.score) == (
        None,
        None,
        None,
        None,
    )
    assert (data.closed_ms, data.secret, data.people[0].completed_ms) == (None, None, None)


def test_the_folder_gives_every_seed_and_says_that_a_study_is_closed(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    recorder.join(0, stage="ranked")
    recorder.close()
    from humanplay.study.folder import Folder

    Folder(tmp_path / "studies").close("dunes")
    reader = Reader.open(tmp_path / "play.db")
    data, seeds = load_with_folder(reader, Folder(tmp_path / "studies"), "dunes")
    assert data.closed_ms is not None
    assert data.secret == study.secret.hex()
    assert seeds == {i: study.seed("ranked", i) for i in range(3)}
    without, begun = load_with_folder(reader, Folder(tmp_path / "elsewhere"), "dunes")
    assert (without.closed_ms, begun) == (None, {})
    reader.close()


def test_a_study_that_nobody_has_joined_is_known_from_its_folder(tmp_path):
    freeze(tmp_path / "studies")
    other = freeze(tmp_path / "others", "moon")
    recorder = StudyRecorder(tmp_path / "play.db", other)
    recorder.close()
    reader = Reader.open(tmp_path / "play.db")
    data, seeds = load_with_folder(reader, Folder(tmp_path / "studies"), "dunes")
    assert (data.people, data.trials, len(seeds)) == ((), (), 3)
    reader.close()


@pytest.mark.parametrize("ranked", [3, 4], ids=["the same protocol", "another"])
def test_two_studies_of_one_name_are_not_mixed(tmp_path, ranked):
    freeze(tmp_path / "studies", ranked=ranked)
    recorder = StudyRecorder(tmp_path / "play.db", freeze(tmp_path / "others"))
    recorder.close()
    reader = Reader.open(tmp_path / "play.db")
    with pytest.raises(StudyError, match="is another one than that in"):
        load_with_folder(reader, Folder(tmp_path / "studies"), "dunes")
    reader.close()
