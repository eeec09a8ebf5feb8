"""Which interval is the headline: failures that are everybody's, a few players' and nobody's."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from app.report import build
from app.report.page import render
from app.report.statistics.intervals import (
    HEADLINE_RULE,
    guaranteed_interval,
    is_a_few_players,
    printed_interval,
)
from app.report.statistics.study_figures import metric_bounds
from app.task import rules_of
from tests.support.made_studies import CONFIG, FROZEN_MS, played, run, study, trial


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


def with_failures(failed):
    """Return the study of five players on six terrains, so many of whose episodes ended in a collision."""
    people, trials = played(np.random.default_rng(4).normal(0.9, 0.01, (5, 6)))
    by = {person.id: index for index, person in enumerate(people)}
    changed = [
        trial(people[by[each.participant]], each.trial, 0.3, steps=9, outcome="collided")
        if each.trial < failed[by[each.participant]]
        else each
        for each in trials
    ]
    return study(people, changed, policies=("frontier-cost", "random"))


def test_the_guaranteed_interval_is_the_headline_where_failures_are_one_players():
    report = build(with_failures((3, 0, 0, 0, 0)))
    found = report.groups[0].figure
    assert found.score.headline == found.steps.headline == "guaranteed"
    means = np.array([player.score for player in report.groups[0].players])
    low, high = guaranteed_interval(means, metric_bounds(rules_of("mars"), CONFIG, "score"))
    assert found.score.interval == (float(low), float(high))
    assert f"guaranteed 95 % interval {low:.3f}" in report.sentence
    assert any(
        "the guaranteed interval is the headline" in line for line in report.groups[0].cautions
    )
    assert report.rule == HEADLINE_RULE
    assert "95 % interval (headline)" in render(report)


def p_values(value, key=""):
    """Return every p of a report as plain values, wherever it stands."""
    if isinstance(value, dict):
        return [p for name, each in value.items() for p in p_values(each, name)]
    if isinstance(value, list):
        return [p for each in value for p in p_values(each, key)]
    return [value] if key.startswith("p_") else []


@pytest.mark.parametrize("failed", [(3, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
def test_a_report_has_p_values_only_where_failures_are_not_a_few_players(failed):
    data = with_failures(failed)
    trials = [
        replace(each, ended_ms=FROZEN_MS + 1000 * int(each.participant, 16) + each.trial,
                started_ms=FROZEN_MS + 1000 * int(each.participant, 16))
        for each in data.trials
    ]  # fmt: skip
    report = build(replace(data, trials=tuple(trials)), [run("frontier-cost", [0.95] * 6)])
    found = p_values(report.to_dict()["groups"])
    page, (group,) = render(report), report.groups
    is_few = failed[0] == 3
    assert len(found) == 2 * 2 + 2, "two comparisons, learning"
    found = [p for p in found if p is not None]
    assert all(p is None for p in found) == is_few
    assert group.comparisons[0].new is not None
    said = "a policy as good as people had a p below 0.05 in up to 45.6 % of studies"
    assert (said in " ".join(group.cautions)) == is_few
    assert page.count(said) == (4 if is_few else 0), "first table, caution, comparison, learning"


@pytest.mark.parametrize("failed", [(1, 1, 1, 1, 1), (0, 0, 0, 0, 0)])
def test_the_printed_interval_is_the_headline_otherwise(failed):
    report = build(with_failures(failed))
    found = report.groups[0].figure.score
    low, high = printed_interval(np.array([player.score for player in report.groups[0].players]))
    assert (found.headline, found.interval) == ("printed", (float(low), min(float(high), 1.0)))
    assert "guaranteed 95 %" not in report.sentence
