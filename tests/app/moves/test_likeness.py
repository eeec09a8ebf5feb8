"""The share of people's moves that a policy would have made too, as the leaderboard shows it."""

from dataclasses import replace

from app.db.reader import Reader
from app.report.moves.likeness import human_likeness, mean_agreement
from app.report.statistics.exclusion_sets import members, people_of
from app.series.data import load
from marsexplorer.evaluation.agreement import Agreement
from tests.support.stored_studies import freeze, play_study


def test_the_mean_agreement_weighs_players():
    agreements = {
        "a": {"ppo": Agreement(100, 50)},
        "b": {"ppo": Agreement(1000, 1000)},
        "c": {"ppo": Agreement()},
    }
    assert mean_agreement(agreements, "ppo") == 0.75
    assert mean_agreement(agreements, "planner") is None


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
