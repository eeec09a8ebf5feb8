"""A player who moves as a policy does stands out among people who do not, and people seldom do."""

from dataclasses import replace

from app.moves.analysis import MoveAnalysis
from app.moves.likeness import find_likeness, human_likeness, mean_agreement
from app.report import build
from app.statistics.exclusion_sets import members, people_of
from app.storage.reader import Reader
from app.study.data import load
from marsexplorer.evaluation.agreement import Agreement
from tests.support.made_studies import played, study
from tests.support.stored_studies import freeze, play_study


def test_somebody_far_above_the_others_stands_out_without_being_exact():
    others = {str(number): {"ppo": Agreement(1000, 700 + 5 * number)} for number in range(9)}
    found = find_likeness({"who": {"ppo": Agreement(1000, 985)}, **others})
    assert [each.participant for each in found if each.stands_out] == ["who"]
    assert not any(
        each.stands_out for each in find_likeness({"who": {"ppo": Agreement(1000, 850)}, **others})
    )


def test_few_moves_and_few_players_say_little():
    found = find_likeness(
        {"who": {"ppo": Agreement(150, 150)}, "other": {"ppo": Agreement(900, 600)}}
    )
    assert [(each.deviation, each.stands_out) for each in found] == [(None, False), (None, False)]
    assert find_likeness({"who": {"ppo": Agreement()}}) == ()


def test_the_mean_agreement_weighs_players():
    agreements = {
        "a": {"ppo": Agreement(100, 50)},
        "b": {"ppo": Agreement(1000, 1000)},
        "c": {"ppo": Agreement()},
    }
    assert mean_agreement(agreements, "ppo") == 0.75
    assert mean_agreement(agreements, "planner") is None


def test_the_report_cautions_and_leaves_nobody_out():
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
    assert group.figures == plain.figures
    (caution,) = set(group.cautions) - set(plain.cautions)
    name = next(
        row.name for row in group.players if row.steps == min(each.steps for each in group.players)
    )
    assert caution.startswith(f"{name} made 100.0 % of 500 moves as the policy ppo would have")


def test_the_leaderboards_share_is_that_of_peoples_moves(tmp_path):
    study_ = freeze(tmp_path / "studies", policies=("random", "frontier-cost"))
    play_study(tmp_path / "play.db", study_)  # people drive as frontier-cost does
    reader = Reader.open(tmp_path / "play.db")
    data = load(reader, "dunes")
    gone = data.protocol.model_copy(
        update={"policies": ("random", "frontier-cost", "no-such.safetensors")}
    )
    data, cohort = replace(data, protocol=gone), people_of(data)
    assert (
        human_likeness(reader, data, cohort, members(cohort, {"completed": True}))["frontier-cost"]
        > 0.8
    )
    assert set(human_likeness(reader, data, cohort, members(cohort, {}))) == {"frontier-cost"}
    assert human_likeness(reader, data, cohort, []) == {}
    reader.close()
