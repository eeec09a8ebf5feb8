"""An open study shows progress and no figures; a closed one shows everything."""

import numpy as np
import pytest

from humanplay.report.build import build
from humanplay.report.page import render
from humanplay.report.statistics.study_figures import live_figure
from tests.support.made_studies import played, run, study

SCORES = np.array(
    [
        [0.9, 0.8, 0.7, 0.9, 0.8, 0.95],
        [0.7, 0.6, 0.8, 0.9, 0.5, 0.9],
        [0.8, 0.85, 0.9, 0.7, 0.9, 0.88],
    ]
    * 2
)


def at(finished, closed=False):
    """Return a study in which so many people have finished and one more is on the way."""
    rows = [*SCORES[:finished], [0.1, 0.1, np.nan, np.nan, np.nan, np.nan]]
    return study(*played(rows), closed=closed, players=8)


@pytest.mark.parametrize("finished", [0, 1, 5])
def test_an_open_study_shows_no_figure_anywhere_in_its_report(finished):
    data = at(finished)
    report = build(data, [run("ppo", [0.9] * 6)])
    expected = f"No figure is shown until the study is closed: {finished} of 8 have finished."
    assert report.sentence == expected
    (group,) = report.groups
    assert {figure.players for figure in group.figures} == {0}
    for shown in (group.metrics, group.players, group.comparisons, group.outcomes, group.labels):
        assert not shown
    assert (group.joined, group.started, group.finished) == (finished + 1, finished + 1, finished)
    means = {f"{score:.3f}" for score in SCORES[:finished].mean(1)}
    for text in (report.to_json(), render(report)):
        assert not [mean for mean in means if mean in text]
    live = live_figure(data)
    assert (live["players"], live["score"], live["steps"]) == (0, None, None)
    assert live["sentence"] == expected


def test_a_closed_study_shows_everything():
    group = build(at(5, closed=True)).groups[0]
    assert (group.figure.players, group.everybody.players) == (5, 6), "one has left"
    assert live_figure(at(5, closed=True))["sentence"].startswith(
        "Figure of unverified participants (attested). Per protocol: 5 players"
    )


def test_scripts_are_shown_at_any_time():
    people, trials = played(SCORES[:3], "script", "noisy-frontier")
    assert build(study(people, trials, closed=False), synthetic=True).groups[0].figure.players == 3
