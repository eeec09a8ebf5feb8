"""Where a study's players lose moves; an open study tells nothing."""

import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from humanplay.db.reader import Reader
from humanplay.report.build import build
from humanplay.report.costs import (
    CostPart,
    _cost_part,
    cost_cache,
    cost_rows,
    costs_of_people,
    costs_of_study,
    no_bar,
    summarize_costs,
)
from humanplay.report.page import render
from humanplay.report.statistics.exclusion_sets import members, people_of
from humanplay.report.statistics.intervals import interval
from humanplay.report.statistics.summaries import summarize_groups
from humanplay.study.data import load, trial_records
from humanplay.study.protocol import StudyError
from marsexplorer.config import ACTIONS
from marsexplorer.evaluation.cost import CostEstimator
from marsexplorer.evaluation.episodes import play_terrain
from marsexplorer.evaluation.mistakes import MistakeKind
from marsexplorer.policies import load as load_policy
from tests.support.command import command, run
from tests.support.stored_studies import StudyRecorder, freeze, play_study


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("costs")
    return folder, play_study(folder / "play.db", freeze(folder / "play.db-studies"))


@pytest.fixture
def reader(place):
    opened = Reader.open(place[0] / "play.db")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def estimator():
    return CostEstimator()


def ranked(data):
    return [trial for trial in data.trials if trial.phase == "ranked" and trial.kind == "human"]


def test_a_row_for_each_move_of_an_episode(reader, estimator):
    data = load(reader, "dunes")
    rows = list(cost_rows(reader, data, ranked(data), estimator))
    for trial, record in trial_records(reader, ranked(data)):
        episode_rows = [row for row in rows if row.episode == trial.id]
        costs, moves = estimator.costs(record), len(record.actions)
        assert [row.step for row in episode_rows] == list(
            range(moves + (record.outcome == "abandoned"))
        )
        assert [row.action for row in episode_rows[:moves]] == [
            ACTIONS[move] for move in record.actions
        ]
        assert [row.action for row in episode_rows[moves:]] == [None] * (len(episode_rows) - moves)
        assert [row.cost for row in episode_rows[:moves]] == costs.costs.tolist()
        assert sum(row.cost for row in episode_rows) == costs.counts - costs.expert_moves
        for kind, cost in costs.by_kind().items():
            assert sum(row.cost for row in episode_rows if row.kind == kind) == cost
        assert sum(row.cost for row in episode_rows if row.kind is None) == costs.gained


def test_costs_stand_beside_experts_episodes_and_add_up(reader, estimator):
    data = load(reader, "dunes")
    cohort = people_of(data)
    ids = [person.id for person in cohort.people]
    summary = summarize_costs(reader, data, cohort, ids, estimator)
    policy = load_policy("ppo", data.protocol.env_config.sensor_radius)
    players = {}
    by_terrain = sorted(ranked(data), key=lambda trial: trial.terrain_index)
    for trial, record in trial_records(reader, by_terrain):
        costs, expert = estimator.costs(record), play_terrain(policy, record)
        players.setdefault(trial.participant, []).append((costs, expert.steps))
    for part, amount in {
        "counts": lambda costs, expert: costs.counts,
        "expert_moves": lambda costs, expert: expert,
        "total": lambda costs, expert: costs.counts - expert,
        "gained": lambda costs, expert: costs.gained,
        "without_move": lambda costs, expert: costs.without_move,
    }.items():
        means = [np.mean([amount(*pair) for pair in pairs]) for pairs in players.values()]
        shown = getattr(summary, part)
        assert getattr(shown, "mean", shown) == pytest.approx(np.mean(means)), part
    assert summary.total.mean == pytest.approx(summary.counts - summary.expert_moves)
    parts = sum(part.mean for part in summary.by_kind.values()) + summary.gained.mean
    tenths = sum(part.mean for part in summary.by_tenth) + summary.without_move.mean
    assert parts == pytest.approx(summary.total.mean) == pytest.approx(tenths)
    assert list(summary.by_kind) == [str(kind) for kind in MistakeKind]
    assert summary.by_kind["ended early"].mean > 0  # an episode was given up
    assert (summary.phase, summary.episodes, summary.policy) == ("ranked", 6, "ppo")
    table = np.array([[costs.total for costs, _ in pairs] for pairs in players.values()], float)
    assert len(players) == 2
    assert summary.total.interval is None, "two players have no interval"
    six = np.repeat(table, 3, axis=0)
    ends = tuple(map(float, interval(six, None, terrains_drawn=False)))
    assert _cost_part(six, False).interval == pytest.approx(ends)
    assert _cost_part(np.zeros((5, 3)), True) == CostPart(0.0, None), "no spread"


def test_without_experts_file_no_move_is_judged_and_the_report_says_so(place):
    database = place[0] / "play.db"
    data = load(database, "dunes")
    without = replace(data, policy_files=replace(data.policy_files, hashes={}))
    reason = "no file of ppo was kept when the study was frozen, so none of its moves is judged"
    with closing(Reader.open(database)) as reader:
        assert costs_of_people(reader, without, no_bar, None) == {}
        with pytest.raises(ValueError, match=reason):
            costs_of_study(reader, without)
    report = build(without)
    assert [(group.costs, group.no_costs) for group in report.groups] == [(None, reason)]
    assert f"No cost of moves: {reason}." in render(report)


def test_the_moves_of_a_spoilt_episode_enter_nothing_that_follows_from_moves(tmp_path, estimator):
    study = freeze(tmp_path / "play.db-studies", policies=("frontier-cost",))
    with closing(StudyRecorder(tmp_path / "play.db", study)) as recorder:
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
            costs = summarize_costs(reader, data, cohort, ids, estimator)
            of_moves.append((costs, summarize_groups(reader, data, False)))
    assert of_moves[0] == of_moves[1]


def test_nothing_of_an_open_studys_ranked_terrains(reader, estimator):
    data = replace(load(reader, "dunes"), closed_ms=None)
    with pytest.raises(
        StudyError, match="nothing of its ranked instances may leave before it is closed"
    ):
        next(cost_rows(reader, data, ranked(data), estimator))


def test_the_analysis_is_kept_next_to_the_database(place):
    database = place[0] / "play.db"
    data = load(database, "dunes")
    with closing(Reader.open(database)) as reader:

        def analyse(data):
            return costs_of_people(reader, data, no_bar, cost_cache(database))

        costs = analyse(data)
        assert costs["people"].total.mean > 0
        assert len(list(cost_cache(database).iterdir())) >= 3
        assert analyse(data) == costs
        assert analyse(replace(data, closed_ms=None)) == {}


def test_the_report_shows_where_people_lose_moves_and_names_nobody(place, tmp_path, capsys):
    folder, people = place
    database = "--database", folder / "play.db"
    files = "--html", tmp_path / "r.html", "--json", tmp_path / "r.json"
    code, _, _ = command(capsys, "report", "--study", "dunes", *database, *files)
    assert code == 0
    page, document = (
        (tmp_path / "r.html").read_text(),
        json.loads((tmp_path / "r.json").read_text()),
    )
    assert "Where people lose moves" in page
    assert "ppo on the same instances" in page
    costs = document["groups"][0]["costs"]
    assert costs["total"]["mean"] == pytest.approx(costs["counts"] - costs["expert_moves"])
    assert {player["player"] for player in costs["by_player"]} == {"P01", "P02"}
    assert not any(person in page or person in json.dumps(document) for person in people)


def test_forgetting_a_participant_deletes_the_costs_that_were_kept(tmp_path, capsys):
    (person, *_) = play_study(tmp_path / "play.db", freeze(tmp_path / "play.db-studies"))
    cost_cache(tmp_path / "play.db").mkdir()
    (cost_cache(tmp_path / "play.db") / "kept.npy").write_bytes(b"")
    assert run("forget", person, "--database", tmp_path / "play.db", "--yes") == 0
    assert not cost_cache(tmp_path / "play.db").exists()


def test_the_command_prints_players_and_writes_every_move(place, tmp_path, capsys):
    folder, people = place
    database = "--database", folder / "play.db"
    written = "--json", tmp_path / "costs.json"
    code, output, err = command(capsys, "costs", "--study", "dunes", *database, *written)
    assert code == 0, err
    assert "cost per ranked episode" in output
    assert "ppo on the same instances" in output
    written = (tmp_path / "costs.json").read_text()
    document = json.loads(written)
    moves = document["moves"]
    assert {move["player"] for move in moves} == {"P01", "P02"}
    assert set(moves[0]) == {"player", "episode", "step", "action", "cost", "expert_action", "kind"}
    assert not any(person in written or person in output for person in people)
