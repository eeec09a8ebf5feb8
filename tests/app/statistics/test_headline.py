"""Whether failures are everybody's, a few players' or nobody's."""

import numpy as np
import pytest
import scipy

from app.report.statistics.intervals import is_a_few_players


def few(*failed, episodes=30):
    return bool(is_a_few_players(np.array(failed, float), np.full(len(failed), float(episodes))))


@pytest.mark.parametrize(
    ("failed", "expected"),
    [
        ((0,) * 10, False),  # nobody's
        ((1, *[0] * 9), True),  # one player has all of them
        ((1, 1, *[0] * 8), False),  # no more than chance
        ((4, 1, *[0] * 8), True),
        ((9, 8, 7, *[0] * 7), True),
        ((9, 8, 7, 9, 8, 7, 0, 0, 0, 0), False),  # more than chance, and six players
        ((1, 2, 1, 3, 0, 2, 1, 1, 2, 1), False),
        ((30,) * 10, False),  # all alike
    ],
)
def test_who_holds_the_failures(failed, expected):
    assert few(*failed) == expected


def test_the_test_of_equal_rates_is_the_textbooks():
    failed, episodes = np.array([6.0, 1, 0, 2]), np.array([30.0, 20, 30, 25])
    p = scipy.stats.chi2_contingency([failed, episodes - failed], correction=False).pvalue
    assert few(*failed) == (p < 0.05)
    assert bool(is_a_few_players(failed, episodes)) == (p < 0.05)
