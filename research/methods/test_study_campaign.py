"""The campaign of cheats, small: the report warns of all that gain something.

All but the accepted ones.
"""

import re

import pytest

from research.methods.study_campaign import ATTACKS, ERASED, MISSING, NEITHER, measure

NOTHING = ("spoiling", "rejoin-link", "forged-pace")
"""What moves no mean."""
NEVER = ("leaving", "slow-start")
"""What makes the mean of everybody worse, and no mean better."""
ACCEPTED = ("ground-secrets",)
"""What gains without a word in the report: the documents give its number."""
DROPPED = ("closing-tab", "giving-up", "last-by-program", "lost-message")
"""What takes the worst two out of who finished, and out of nothing else."""
GONE = ("erasing-open", "erasing", "withdrawing")
"""What takes the worst two out of both."""
REMOVED = ("hurrying",)
"""What makes bots of the worst two."""


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    measured = measure(list(ATTACKS), tmp_path_factory.mktemp("campaign"), [0], 4, 2)
    return {row.name: row for row in measured}


def test_what_shall_gain_nothing_gains_nothing(rows):
    for name in NOTHING:
        assert not rows[name].gain.any(), name
    for name in NEVER:
        per_protocol, everybody, _ = rows[name].gain
        assert per_protocol <= 0 > everybody, name


def test_the_report_warns_of_whatever_may_gain(rows):
    gaining = {name: row for name, row in rows.items() if (row.gain > 0).any()}
    assert {*gaining} == {*rows} - {*NOTHING, *NEVER}
    for name, row in gaining.items():
        assert bool(row.warning) == (name not in ACCEPTED), name


@pytest.mark.parametrize("name", [*DROPPED, *GONE, *REMOVED, "best-of-three"])
def test_a_caution_is_earned_and_names_how_many_are_missing_and_both_means(rows, name):
    row = rows[name]
    assert row.twin is None, "an honest study has no such caution"
    per_protocol, everybody, _ = row.gain
    assert per_protocol > 0
    if name in DROPPED:
        assert everybody <= 0, "so no difference is claimed"
        assert re.match(f"2 {MISSING}", row.warning)
        assert re.search("steps to 99 % per protocol, .* steps to 99 % of everybody", row.warning)
    elif name in REMOVED:
        assert re.match(f"2 {NEITHER}", row.warning)
    elif name in GONE:
        assert re.match(f"2 {ERASED}", row.warning)
        for estimate in ("per protocol", "everybody"):
            assert re.search(f"{estimate}, mean steps .* without them, .* to .*", row.warning)
