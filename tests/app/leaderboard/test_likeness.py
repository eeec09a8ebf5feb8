"""The share of people's moves that a policy would have made too, as the leaderboard shows it."""

from dataclasses import replace

import numpy as np
import pytest

from humanplay.db.reader import Reader
from humanplay.report.statistics.exclusion_sets import members, people_of
from humanplay.series.data import load, trial_records
from humanplay.web.leaderboard.entries import human_likeness
from marsexplorer.evaluation.episodes import agreement_with
from marsexplorer.policies import load as load_policy
from tests.support.stored_studies import freeze, play_study


def test_the_leaderboards_share_is_that_of_peoples_moves(tmp_path):
    study_ = freeze(tmp_path / "play.db-studies", policies=("random", "frontier-cost"))
    play_study(tmp_path / "play.db", study_)  # people drive as frontier-cost does
    reader = Reader.open(tmp_path / "play.db")
    data = load(reader, "dunes")
    gone = data.protocol.model_copy(
        update={"policies": ("random", "frontier-cost", "no-such.onnx")}
    )
    data, cohort = replace(data, protocol=gone), people_of(data)
    ids = members(cohort, {"completed": True})
    policy, shares = load_policy("frontier-cost", data.protocol.env_config.sensor_radius), []
    for person in ids:
        first = [each for each in cohort.ranked[person] if each.terrain_index < 2]
        both = [agreement_with(policy, record) for _, record in trial_records(reader, first)]
        shares.append(sum(each.agreed for each in both) / sum(each.moves for each in both))
    found = human_likeness(reader, data, cohort, ids)["frontier-cost"]
    assert found > 0.8
    assert found == pytest.approx(np.mean(shares))
    assert set(human_likeness(reader, data, cohort, members(cohort, {}))) == {"frontier-cost"}
    assert human_likeness(reader, data, cohort, []) == {}
    reader.close()
