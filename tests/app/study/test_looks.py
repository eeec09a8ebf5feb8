"""What may be seen of an open study: nothing, or exactly a planned look, or everything after an act that is logged."""

import json
import multiprocessing
from dataclasses import replace

import numpy as np
import pytest

from app.report import build
from app.report.page import render
from app.statistics.intervals import estimate
from app.statistics.sequential import boundaries
from app.statistics.study_figures import live_figure, metric_bounds
from app.study.folder import Folder
from app.study.looks import LOOKS_FILE, emergency_view, present, read_looks, take_look
from app.study.protocol import StudyError
from tests.support.made_studies import CONFIG, played, run, study
from tests.support.stored_studies import freeze

SCORES = np.array(
    [
        [0.9, 0.8, 0.7, 0.9, 0.8, 0.95],
        [0.7, 0.6, 0.8, 0.9, 0.5, 0.9],
        [0.8, 0.85, 0.9, 0.7, 0.9, 0.88],
    ]
    * 3
)
PLAN = {"players": 8, "looks": [4, 8], "spending": "obrien-fleming"}


def at(finished, closed=False, **rest):
    """Return a study in which so many people have finished and one more is on the way."""
    rows = [*SCORES[:finished], [0.1, 0.1, np.nan, np.nan, np.nan, np.nan]]
    return study(*played(rows), closed=closed, **rest)


def figure_of(data):
    return build(data).groups[0].figure


@pytest.mark.parametrize("finished", [0, 1, 5])
def test_an_open_study_shows_no_figure_anywhere_in_its_report(finished):
    data = at(finished, players=8)
    report = build(data, [run("ppo", [0.9] * 6)])
    assert (
        report.sentence
        == f"No figure is shown until the study is closed: {finished} of 8 have finished."
    )
    (group,) = report.groups
    assert {figure.players for figure in group.figures} == {0}
    assert (group.metrics, group.players, group.comparisons, group.outcomes, group.labels) == (
        (),
        (),
        (),
        {},
        {},
    )
    assert (group.joined, group.started, group.finished) == (finished + 1, finished + 1, finished)
    for text in (report.to_json(), render(report)):
        assert not [
            score for score in np.unique(SCORES[:finished].mean(1)) if f"{score:.3f}" in text
        ]
    live = live_figure(data)
    assert (live["players"], live["score"], live["steps"], live["view"]) == (
        0,
        None,
        None,
        "hidden",
    )
    assert live["sentence"] == report.sentence


def test_an_earlier_protocol_shows_its_figure_at_any_time_and_a_closed_study_shows_everything():
    assert figure_of(at(5, hides_interim=False)).players == 5
    assert live_figure(at(5, hides_interim=False))["sentence"].startswith("5 players")
    closed = build(at(5, closed=True))
    assert (closed.groups[0].figure.players, closed.look) == (5, None)
    assert closed.groups[0].figures[0].players == 6  # the one who left is in the set of all


def test_a_look_shows_exactly_the_first_who_finished_until_the_next_look():
    before = at(3, **PLAN)
    assert live_figure(before)["sentence"] == (
        "No figure is shown until 4 players have finished, the first planned look: 3 of 8 have finished."
    )
    frozen = [figure_of(at(finished, **PLAN)) for finished in (4, 5, 6, 7)]
    assert all(each == frozen[0] for each in frozen)
    means = SCORES[:4].mean(1)
    level = boundaries("obrien-fleming", [0.5])[0].confidence
    wanted = estimate(means, metric_bounds(CONFIG, "score"), level)
    assert frozen[0].score.interval == pytest.approx(wanted.interval)
    assert frozen[0].score.interval[1] - frozen[0].score.interval[0] > 2 * (
        frozen[0].score.t[1] - frozen[0].score.t[0]
    )
    assert figure_of(at(8, **PLAN)).players == figure_of(at(9, **PLAN)).players == 8


def test_the_first_are_those_who_finished_first_not_those_who_joined_first():
    data = at(5, **PLAN)
    late = replace(data.people[0], completed_ms=data.people[4].completed_ms + 1)
    shown = figure_of(replace(data, people=(late, *data.people[1:])))
    assert shown.score.mean == pytest.approx(SCORES[1:5].mean())


def test_a_report_of_a_look_names_the_look_its_boundary_and_whether_it_was_crossed(tmp_path):
    report = build(
        at(5, **PLAN), [run("ppo", [0.99] * 6, [1] * 6), run("near", [0.8] * 6, [24] * 6)]
    )
    look = report.look
    assert (look.number, look.of, look.players, look.planned, look.is_final) == (1, 2, 4, 8, False)
    assert (look.z, look.spent) == (
        pytest.approx(2.9626, abs=2e-4),
        pytest.approx(0.00305, abs=1e-5),
    )
    crossed = {(each.policy, each.metric): each.crossed for each in look.crossings}
    assert (crossed["ppo", "steps"], crossed["near", "steps"]) == (True, False)
    words = "Planned look 1 of 2, at the first 4 of 8 players who finished; it does not change until 8 have finished. 4 players,"
    assert report.sentence.startswith(
        f"{words} 24 ranked episodes: mean score 0.814 (99.69 % interval "
    )
    page = render(report)
    assert "the boundary is crossed" in page
    assert "Look 1 of 2, at 4 of 8 players" in page


@pytest.mark.parametrize(
    ("finished", "players", "fractions"),
    [(2, 2, [0.25]), (4, 4, [0.5]), (6, 6, [0.5, 0.75]), (8, 8, [0.5, 1]), (9, 8, [0.5, 1])],
)
def test_the_end_of_a_study_with_looks_is_its_last_look(finished, players, fractions):
    data = at(finished, closed=True, **PLAN)
    report = build(data)
    assert (report.groups[0].figure.players, report.look.is_final) == (players, True)
    assert (
        report.groups[0].figure.score.confidence
        == boundaries("obrien-fleming", fractions)[-1].confidence
    )
    assert live_figure(data)["sentence"] == report.sentence
    assert report.groups[0].figures[0].players == players + 1


def test_scripts_are_shown_at_any_time():
    people, trials = played(SCORES[:3], "script", "noisy-frontier")
    assert build(study(people, trials, closed=False), synthetic=True).groups[0].figure.players == 3


def test_looks_are_logged_and_an_emergency_look_says_so_for_ever(tmp_path):
    folder = Folder(tmp_path)
    freeze(tmp_path, "made", close=False, **PLAN)
    for finished in (3, 4, 6):
        take_look(folder, at(finished, **PLAN))
    kept = read_looks(tmp_path / "made" / LOOKS_FILE)
    assert [(each.kind, each.finished, each.players) for each in kept] == [("planned", 4, 4)]
    shown = take_look(folder, at(3, **PLAN), "the page froze for two people")
    assert figure_of(shown).players == 3
    report = build(shown)
    assert report.sentence.startswith(
        "EMERGENCY LOOK, outside the plan, when 3 of 8 players had finished. 3 players,"
    )
    kept = read_looks(tmp_path / "made" / LOOKS_FILE)
    assert [(each.kind, each.reason) for each in kept][1:] == [
        ("emergency", "the page froze for two people")
    ]
    later = build(replace(at(8, closed=True, **PLAN), looks=kept))
    assert any(
        "outside the plan was taken at 20" in line and "the page froze" in line
        for line in later.deviations
    )
    assert "the page froze for two people" in render(later)


def test_nothing_is_shown_that_cannot_be_logged(tmp_path):
    with pytest.raises(StudyError, match="cannot be logged, so nothing is shown"):
        take_look(Folder(tmp_path), at(4, **PLAN))
    with pytest.raises(StudyError, match="cannot be logged, so nothing is shown"):
        take_look(Folder(tmp_path), at(3, **PLAN), "a reason of some length")
    freeze(tmp_path, "made", close=False, **PLAN)
    with pytest.raises(StudyError, match="at least 10 characters"):
        take_look(Folder(tmp_path), at(3, **PLAN), "  because ")
    (tmp_path / "made" / LOOKS_FILE).write_text("{")
    with pytest.raises(StudyError, match="restore it from a backup"):
        take_look(Folder(tmp_path), at(4, **PLAN))


def test_an_emergency_look_at_what_is_shown_anyway_is_refused():
    for data in (at(3, closed=True), at(3, hides_interim=False)):
        with pytest.raises(StudyError, match="hides no figure"):
            emergency_view(data)


def _look(root):
    take_look(Folder(root), at(3, **PLAN), "one of several at once")


def test_looks_of_several_processes_are_all_kept(tmp_path):
    freeze(tmp_path, "made", close=False, **PLAN)
    processes = [
        multiprocessing.get_context("fork").Process(target=_look, args=(tmp_path,))
        for _ in range(6)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert len(json.loads((tmp_path / "made" / LOOKS_FILE).read_text())) == 6


def test_what_is_presented_once_is_not_presented_again():
    once = present(at(5, **PLAN))
    assert present(once) is once
