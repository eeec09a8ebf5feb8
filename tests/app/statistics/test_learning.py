"""Learning over the ranked trials, against literal twins and scipy."""

import numpy as np
import pytest
import scipy

from humanplay.report.statistics.learning import assess_learning, tost
from marsexplorer.intervals import t_interval

NAN = float("nan")


def test_slopes_and_changes_over_trials():
    rng = np.random.default_rng(6)
    table = 100 - 0.3 * np.arange(12) + rng.normal(0, 1, (9, 12))
    learning = assess_learning("steps", table, 5.0)
    slopes = [np.polyfit(np.arange(12), row, 1)[0] for row in table]
    assert learning.slope == pytest.approx(np.mean(slopes))
    assert learning.slope_interval == pytest.approx(t_interval(np.array(slopes)))
    changes = table[:, -4:].mean(1) - table[:, :4].mean(1)
    assert learning.change == pytest.approx(changes.mean())
    assert learning.change_interval == pytest.approx(t_interval(changes))
    assert learning.verdict == "changed, within the margin"
    assert learning.by_trial[3][:2] == (9, pytest.approx(table[:, 3].mean()))


def test_the_equivalence_test_is_two_one_sided_t_tests():
    changes = np.array([1.0, -2.0, 0.5, 3.0, -1.0, 2.0])
    ends, p = tost(changes, 4.0)
    above = scipy.stats.ttest_1samp(changes, -4.0, alternative="greater").pvalue
    below = scipy.stats.ttest_1samp(changes, 4.0, alternative="less").pvalue
    assert p == pytest.approx(max(above, below))
    assert ends == pytest.approx(
        scipy.stats.t.interval(0.9, 5, changes.mean(), scipy.stats.sem(changes))
    )
    assert (p < 0.05) == (ends[0] > -4 and ends[1] < 4)


@pytest.mark.parametrize(
    ("shift", "noise", "margin", "verdict"),
    [
        (0, 1, 5.0, "flat"),
        (-30, 1, 5.0, "changed"),
        (0, 60, 5.0, "undecided"),
        (0, 1, None, "not tested"),
        (-30, 1, None, "not tested"),
    ],
)
def test_verdicts_on_learning(shift, noise, margin, verdict):
    rng = np.random.default_rng(8)
    table = 100 + np.linspace(0, shift, 9) + rng.normal(0, noise, (10, 9))
    assert assess_learning("steps", table, margin).verdict == verdict


def test_without_a_margin_that_the_protocol_names_learning_has_slope_and_interval_alone():
    table = 100 + np.random.default_rng(8).normal(0, 1, (10, 9))
    learning = assess_learning("steps", table, None)
    assert (learning.equivalence, learning.p_equivalence) == (None, None)
    assert learning.slope_interval[0] < learning.slope < learning.slope_interval[1]


def test_learning_of_one_player_or_of_gaps_is_untested_not_an_error():
    assert assess_learning("steps", np.array([[1.0, 2.0, 3.0]]), 5.0).verdict == "not tested"
    gaps = np.array(
        [
            [1.0, NAN, NAN, NAN, NAN, NAN],
            [1.0, 2.0, 2.0, 3.0, 3.0, 2.0],
            [2.0, 2.0, 2.0, 2.0, 2.0, 2.0],
        ]
    )
    learning = assess_learning("steps", gaps, 5.0)
    assert [row[0] for row in learning.by_trial] == [3, 2, 2, 2, 2, 2]
    assert learning.change == pytest.approx(np.mean([1.0, 0.0]))
