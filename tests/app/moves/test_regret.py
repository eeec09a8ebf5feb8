"""Where a study's players lose moves: rows, the summary over players, and nothing of an open study's ranked terrains."""

import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from app.db.reader import Reader
from app.report.regret import (
    _part,
    no_bar,
    regret_cache,
    regret_rows,
    regrets_of_groups,
    summarize_regret,
)
from app.report.statistics.comparisons import new_terrains_interval
from app.report.statistics.exclusion_sets import members, people_of
from app.report.statistics.intervals import printed_interval
from app.report.statistics.summaries import summarize_groups
from app.series.data import load, trial_records
from app.series.protocol import StudyError
from app.web.leaderboard.entries import human_likeness
from marsexplorer.config import ACTIONS
from marsexplorer.evaluation.episodes import play_terrain
from marsexplorer.evaluation.losses import LossKind
from marsexplorer.evaluation.regret import RegretEstimator
from marsexplorer.policies import load as load_policy
from tests.support.command import command, run
from tests.support.stored_studies import StudyRecorder, freeze, play_study


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("regret")
    return folder, play_study(folder / "play.db", freeze(folder / "studies"))


@pytest.fixture
def reader(place):
    opened = Reader.open(place[0] / "play.db")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def estimator():
    return RegretEstimator()


def ranked(data):
    return [trial for trial in data.trials if trial.phase == "ranked" and trial.kind == "human"]


def test_a_row_for_each_move_of_an_episode(reader, estimator):
    data = load(reader, "dunes")
    rows = list(regret_rows(reader, data, ranked(data), estimator))
    for trial, record in trial_records(reader, ranked(data)):
        own = [row for row in rows if row.episode == trial.id]
        assert [row.step for row in own] == list(range(len(record.actions)))
        assert [row.action for row in own] == [ACTIONS[action] for action in record.actions]
        assert [row.regret for row in own] == estimator.regret(record).regret.tolist()
        assert all((row.kind is None) == (row.regret == 0) for row in own)


def literal_part(rows):
    """Return players' means, policy's mean and the paired difference of {(player, terrain): (theirs, policy's)}."""
    players, terrains = (sorted({key[axis] for key in rows}) for axis in (0, 1))
    theirs = [np.mean([rows[who, at][0] for at in terrains]) for who in players]
    by_terrain = [np.mean([rows[who, at][0] for who in players]) for at in terrains]
    policy = [rows[players[0], at][1] for at in terrains]
    return np.array(theirs), np.mean(policy), np.mean(np.subtract(by_terrain, policy))


def test_regret_is_given_beside_the_policys_own_by_kind_paired_by_terrain(reader, estimator):
    data = load(reader, "dunes")
    cohort = people_of(data)
    ids = [person.id for person in cohort.people]
    found = summarize_regret(reader, data, cohort, ids, estimator)
    policy = load_policy("ppo", data.protocol.env_config.sensor_radius)
    cells = {}
    for trial, record in trial_records(reader, ranked(data)):
        own = estimator.regret(play_terrain(policy, record).record())
        cells[trial.participant, trial.terrain_index] = estimator.regret(record), own
    parts = {"all": lambda each: each.total} | {
        kind: lambda each, kind=kind: each.by_kind()[kind] for kind in LossKind
    }
    given = {"all": found.total, **found.by_kind}
    assert list(given) == ["all", *map(str, LossKind)]
    for kind, value in parts.items():
        rows = {key: tuple(map(value, both)) for key, both in cells.items()}
        means, of_policy, excess = literal_part(rows)
        part = given[str(kind)]
        assert (part.mean, part.policy) == pytest.approx((means.mean(), of_policy)), kind
        assert part.excess == pytest.approx(excess), kind
        if np.ptp(means):
            low, high = map(float, printed_interval(np.sort(means)))
            assert part.interval == pytest.approx((max(0, low), high)), kind
            assert part.excess_interval is None, "three players"
    assert found.by_kind["ended early"].mean > 0  # an episode was given up
    assert sum(each.excess for each in found.by_kind.values()) == pytest.approx(found.total.excess)
    assert (found.phase, found.episodes, found.policy) == ("ranked", 6, "ppo")


def test_what_players_lose_as_the_policy_does_on_a_terrain_is_no_excess():
    policy = np.array([40.0, 0.0, 10.0, 3.0])
    players = np.array([[1.0], [2.0], [4.0], [2.5], [2.5]])
    found = _part(policy + players, policy)
    low, high = new_terrains_interval(np.repeat(players, 4, axis=1))
    assert (found.excess, found.excess_interval) == (
        pytest.approx(2.4),
        pytest.approx((low, high)),
    )
    assert found.excess_interval == pytest.approx((1, 4)), "the terrains add no doubt"
    assert found.mean == pytest.approx(policy.mean() + 2.4)
    same = _part(np.zeros((3, 4)), np.zeros(4))
    assert (same.interval, same.excess_interval) == (None, None), "nothing was lost by anybody"


def test_the_moves_of_a_spoilt_episode_enter_nothing_that_follows_from_moves(tmp_path, estimator):
    made = freeze(tmp_path / "studies", policies=("frontier-cost",))
    with closing(StudyRecorder(tmp_path / "play.db", made)) as recorder:
        for number in range(2):
            person = recorder.join(number)
            for trial in range(3):
                spoil = 2 if (number, trial) == (1, 0) else None
                recorder.play(person, "ranked", trial, spoil=spoil)
    with closing(Reader.open(tmp_path / "play.db")) as reader:
        whole = load(reader, "dunes")
        clean = replace(whole, trials=[t for t in whole.trials if t.attestation != "spoilt"])
        assert len(clean.trials) == 5
        of_moves = []
        for data in (whole, clean):
            cohort = people_of(data)
            ids = sorted(members(cohort, {}))
            regret = summarize_regret(reader, data, cohort, ids, estimator)
            likeness = human_likeness(reader, data, cohort, ids)
            of_moves.append((regret, summarize_groups(reader, data, False), likeness))
    assert of_moves[0] == of_moves[1]


def test_nothing_of_an_open_studys_ranked_terrains(reader, estimator):
    data = replace(load(reader, "dunes"), closed_ms=None)
    with pytest.raises(
        StudyError, match="nothing of its ranked terrains may leave before it is closed"
    ):
        next(regret_rows(reader, data, ranked(data), estimator))


def test_the_analysis_is_kept_next_to_the_database(place):
    database = place[0] / "play.db"
    data = load(database, "dunes")
    with closing(Reader.open(database)) as reader:

        def analyse(data):
            return regrets_of_groups(reader, data, False, no_bar, regret_cache(database))

        found = analyse(data)
        assert found["people"].total.mean > 0
        assert len(list(regret_cache(database).iterdir())) >= 3
        assert analyse(data) == found
        assert analyse(replace(data, closed_ms=None)) == {}


def test_the_report_shows_where_people_lose_moves_and_names_nobody(place, tmp_path, capsys):
    folder, people = place
    where = "--database", folder / "play.db", "--studies", folder / "studies"
    files = "--html", tmp_path / "r.html", "--json", tmp_path / "r.json"
    code, said, _ = command(capsys, "report", "--study", "dunes", *where, *files)
    assert (code, "players minus ppo" in said) == (0, True)
    page, document = (
        (tmp_path / "r.html").read_text(),
        json.loads((tmp_path / "r.json").read_text()),
    )
    assert "Where people lose moves" in page
    assert "so their sum may exceed the moves made" in page
    regret = document["groups"][0]["regret"]
    assert {each["player"] for each in regret["by_player"]} == {"P01", "P02"}
    assert not any(person in page or person in json.dumps(document) for person in people)


def test_forgetting_a_participant_deletes_the_regrets_that_were_kept(tmp_path, capsys):
    (person, *_) = play_study(tmp_path / "play.db", freeze(tmp_path / "studies"))
    regret_cache(tmp_path / "play.db").mkdir()
    (regret_cache(tmp_path / "play.db") / "kept.npy").write_bytes(b"")
    assert run("forget", person, "--database", tmp_path / "play.db", "--yes") == 0
    assert not regret_cache(tmp_path / "play.db").exists()


def test_the_command_prints_players_and_writes_every_move(place, tmp_path, capsys):
    folder, people = place
    where = "--database", folder / "play.db", "--studies", folder / "studies"
    written = "--json", tmp_path / "regret.json"
    code, said, err = command(capsys, "regret", "--study", "dunes", *where, *written)
    assert code == 0, err
    assert "regret per ranked episode" in said
    assert "ppo’s own" in said
    written = (tmp_path / "regret.json").read_text()
    document = json.loads(written)
    moves = document["moves"]
    assert {move["player"] for move in moves} == {"P01", "P02"}
    assert set(moves[0]) == {"player", "episode", "step", "action", "regret", "best_action", "kind"}
    assert not any(person in written or person in said for person in people)
