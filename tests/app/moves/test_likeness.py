"""The share of a player's moves that a policy would have made."""

from dataclasses import replace

from app.db.reader import Reader
from app.report import build
from app.report.moves.analysis import MoveAnalysis
from app.report.moves.likeness import find_likeness, human_likeness, mean_agreement
from app.report.statistics.exclusion_sets import members, people_of
from app.series.data import load
from marsexplorer.evaluation.agreement import Agreement
from tests.support.made_studies import played, study
from tests.support.stored_studies import freeze, play_study


def test_the_share_of_moves_is_given_and_players_without_a_move_are_left_out():
    found = find_likeness({"who": {"ppo": Agreement(200, 150)}, "none": {"ppo": Agreement()}})
    assert [(each.participant, each.moves, each.share) for each in found] == [("who", 200, 0.75)]


def test_the_mean_agreement_weighs_players():
    agreements = {
        "a": {"ppo": Agreement(100, 50)},
        "b": {"ppo": Agreement(1000, 1000)},
        "c": {"ppo": Agreement()},
    }
    assert mean_agreement(agreements, "ppo") == 0.75
    assert mean_agreement(agreements, "planner") is None


def test_the_report_gives_the_share_and_leaves_nobody_out():
    people, trials = played([[0.9] * 6, [0.8] * 6])
    agreements = {
        person.id: {"ppo": Agreement(500, 500 - 100 * number)}
        for number, person in enumerate(people)
    }
    analysis = {"people": MoveAnalysis(None, find_likeness(agreements))}
    plain, group = (
        build(study(people, trials)).groups[0],
        build(study(people, trials), moves=analysis).groups[0],
    )
    assert (group.figures, group.cautions) == (plain.figures, plain.cautions)
    assert {each.share for each in group.moves.likeness} == {1.0, 0.8}


def test_the_leaderboards_share_is_that_of_peoples_moves(tmp_path):
    study_ = freeze(tmp_path / "studies", policies=("random", "frontier-cost"))
    play_study(tmp_path / "play.db", study_)  # people drive as frontier-cost does
    reader = Reader.open(tmp_path / "play.db")
    data = load(reader, "dunes")
    gone = data.protocol.model_copy(
        update={"policies": ("random", "frontier-cost", "no-such.onnx")}
    )
    data, cohort = replace(data, protocol=gone), people_of(data)
    assert (
        human_likeness(reader, data, cohort, members(cohort, {"completed": True}))["frontier-cost"]
        > 0.8
    )
    assert set(human_likeness(reader, data, cohort, members(cohort, {}))) == {"frontier-cost"}
    assert human_likeness(reader, data, cohort, []) == {}
    reader.close()
