"""The upper median and the second best of first attempts, from the definitions."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from humanplay.report.build import build
from humanplay.report.page import render
from humanplay.report.statistics.exclusion_sets import people_of
from humanplay.report.statistics.first_attempts import first_attempts
from tests.support.made_studies import played, study

NAN = float("nan")


def test_the_upper_median_and_the_second_best_are_of_those_who_completed_the_terrain():
    moves = np.array([[30, 45, 9], [20, 52, 9], [40, 50, 9], [10, 61, 9], [25, 57, 9]])
    scores = np.where(moves > 0, 0.9, NAN)
    scores[4, 2] = NAN  # left before the last terrain
    people, trials = played(scores, steps=moves)
    lost = {(people[3].id, 0): "abandoned", (people[0].id, 1): "spoilt"}
    lost |= {(person.id, 2): "collided" for person in people[1:]}
    changed = []
    for trial in trials:
        how = lost.get((trial.participant, trial.terrain_index))
        rest = {"attestation": "spoilt"} if how == "spoilt" else {"outcome": how} if how else {}
        changed.append(replace(trial, **rest))
    data = study(people, changed, ranked=3, required_attestation="attested")
    attempts = first_attempts(people_of(data))
    first, second, third = attempts.terrains
    assert (first.played, first.completed) == (5, 4)  # 20, 25, 30, 40
    assert (first.upper_median, first.second_best) == (30, 25)
    assert (second.played, second.completed) == (5, 4)  # 50, 52, 57, 61
    assert (second.upper_median, second.second_best) == (57, 52)
    assert (first.score, first.best_score) == (0.9, 0.9)
    assert (third.played, third.completed, third.upper_median, third.second_best) == (
        4,
        1,
        None,
        None,
    )
    assert attempts.counted == 2
    assert (attempts.upper_median.mean, attempts.second_best.mean) == (43.5, 38.5)
    half = scipy.stats.t.ppf(0.975, 1) * np.std([30, 57], ddof=1) / 2**0.5
    assert attempts.upper_median.interval == pytest.approx((43.5 - half, 43.5 + half))
    page = render(build(data))
    assert "First attempts, as ARC-AGI-3 counts them" in page
    assert "mean of 2" in page


def test_the_medians_interval_is_of_order_statistics_and_takes_six_people():
    def interval(count):
        people, trials = played(np.full((count, 1), 0.9), steps=np.arange(10, 10 + count)[:, None])
        return first_attempts(people_of(study(people, trials, ranked=1))).terrains[0].interval

    assert interval(5) is None
    for count in (6, 10, 13):
        rank = int(scipy.stats.binom.ppf(0.025, count, 0.5))  # P(fewer below the median) < 2.5 %
        assert interval(count) == (10 + rank - 1, 10 + count - rank)
