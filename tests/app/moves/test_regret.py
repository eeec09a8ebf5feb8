"""Where a study's players lose moves: rows, the summary over players, and nothing of an open study's ranked terrains."""

import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from app.cli.main import main
from app.db.reader import Reader
from app.report.moves.analysis import analyse_moves, no_bar
from app.report.moves.regret import regret_cache, regret_rows, summarize_regret
from app.report.statistics.exclusion_sets import people_of
from app.report.statistics.intervals import printed_interval
from app.series.data import load, trial_records
from app.series.protocol import StudyError
from marsexplorer.config import ACTIONS
from marsexplorer.evaluation.regret import RegretEstimator
from tests.support.stored_studies import freeze, play_study


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


def test_the_summary_weighs_players_and_not_episodes(reader, estimator):
    data = load(reader, "dunes")
    cohort = people_of(data)
    ids = [person.id for person in cohort.people]
    found = summarize_regret(reader, data, cohort, ids, estimator)
    totals = {player: [] for player in ids}
    for trial, record in trial_records(reader, ranked(data)):
        totals[trial.participant].append(estimator.regret(record).total)
    means = np.sort([np.mean(own) for own in totals.values()])
    assert found.mean == pytest.approx(means.mean())
    low, high = map(float, printed_interval(means))
    assert found.interval == pytest.approx((max(0, low), high))
    assert sum(found.by_kind.values()) == pytest.approx(1)
    assert found.by_kind["ended early"] > 0  # an episode was given up
    assert (found.phase, found.episodes, found.policy) == ("ranked", 6, "ppo")
    assert found.policy_mean >= 0


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

        def analyse(data, policy):
            return analyse_moves(reader, data, (policy,), False, no_bar)["people"]

        found = analyse(data, "frontier-cost")
        assert found.regret.mean > 0
        assert {each.policy for each in found.likeness} == {"frontier-cost"}
        assert len(list(regret_cache(database).iterdir())) >= 3
        assert analyse(data, "frontier-cost") == found
        opened = analyse(replace(data, closed_ms=None), "random")
    assert opened.regret is None
    assert opened.likeness == ()


def test_the_report_shows_where_people_lose_moves_and_names_nobody(place, tmp_path, capsys):
    folder, people = place
    where = ("--database", str(folder / "play.db"), "--studies", str(folder / "studies"))
    with pytest.raises(SystemExit) as left:
        main(
            [
                "report",
                "--study",
                "dunes",
                *where,
                "--html",
                str(tmp_path / "r.html"),
                "--json",
                str(tmp_path / "r.json"),
            ]
        )
    assert not left.value.code
    assert "regret: " in capsys.readouterr().out
    page, document = (
        (tmp_path / "r.html").read_text(),
        json.loads((tmp_path / "r.json").read_text()),
    )
    assert "Where people lose moves" in page
    moves = document["groups"][0]["moves"]
    assert {each["player"] for each in moves["regret"]["by_player"]} == {"P01", "P02"}
    assert not any(person in page or person in json.dumps(document) for person in people)


def test_forgetting_a_participant_deletes_the_regrets_that_were_kept(tmp_path, capsys):
    (person, *_) = play_study(tmp_path / "play.db", freeze(tmp_path / "studies"))
    regret_cache(tmp_path / "play.db").mkdir()
    (regret_cache(tmp_path / "play.db") / "kept.npy").write_bytes(b"")
    with pytest.raises(SystemExit) as left:
        main(["forget", person, "--database", str(tmp_path / "play.db"), "--yes"])
    assert not left.value.code, capsys.readouterr().err
    assert not regret_cache(tmp_path / "play.db").exists()


def test_the_command_prints_players_and_writes_every_move(place, tmp_path, capsys):
    folder, people = place
    where = ("--database", str(folder / "play.db"), "--studies", str(folder / "studies"))
    with pytest.raises(SystemExit) as left:
        main(["regret", "--study", "dunes", *where, "--json", str(tmp_path / "regret.json")])
    said = capsys.readouterr()
    assert not left.value.code, said.err
    assert "regret per ranked episode" in said.out
    assert "ppo itself on the same terrains" in said.out
    written = (tmp_path / "regret.json").read_text()
    document = json.loads(written)
    moves = document["moves"]
    assert {move["player"] for move in moves} == {"P01", "P02"}
    assert set(moves[0]) == {"player", "episode", "step", "action", "regret", "best_action", "kind"}
    assert not any(person in written or person in said.out for person in people)
