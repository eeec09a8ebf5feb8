"""Two estimates: of people who finished, and of everybody who began."""

import json
from dataclasses import replace

import numpy as np
import pytest

from humanplay.db.rows import StageEvent
from humanplay.report.build import build
from humanplay.report.page import render
from humanplay.study import policy_episodes
from humanplay.study.flow import Arrivals
from humanplay.study.protocol import default_protocol, protocol_hash
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description
from tests.support.made_studies import CONFIG, FROZEN_MS, person, played, study, trial

CLOSED_MS = FROZEN_MS + 10_000_000
LIMIT = CONFIG.limit
LOWEST = environment_of("mars").bounds(CONFIG)[0]
TERRAINS = 6
HONEST = np.full((4, TERRAINS), 0.9)
STEPS = np.arange(4)[:, None] * 10 + np.full((4, TERRAINS), 20)
"""The last of the honest people is the worst."""


def with_last(change, keep=lambda number: True, **who):
    """The honest study with other trials for the worst person.

    Trials of theirs whose numbers `keep` refuses are left out.
    """
    people, trials = played(HONEST, steps=STEPS)
    worst = people[-1]
    people[-1] = replace(worst, **who)
    of_worst = [episode for episode in trials if episode.participant == worst.id]
    others = [episode for episode in trials if episode.participant != worst.id]
    changed = [
        replace(episode, **change(episode.trial)) for episode in of_worst if keep(episode.trial)
    ]
    return study(people, others + changed)


def first(number):
    return number == 0


LEFT = {"completed_ms": None, "stage": "ranked"}
WITHDREW = {"completed_ms": None, "stage": "withdrawn"}
INTERRUPTED = {**LEFT, "events": (StageEvent(CLOSED_MS, "interrupted", {}),)}
STOPPED_ID = f"{3:032x}-0"
STOPPED = {**LEFT, "events": (StageEvent(1, "stopped", {"episode": STOPPED_ID}),)}
UNATTESTED = {"attestation": "unattested", "attestation_reason": "step 0: no press of its own"}
PROGRAM = {
    "attestation": "unattested",
    "attestation_reason": "step 0: the browser does not vouch for the press",
}
# how the worst person ends: their trials, those that are there, their row; status, terrains as played and at the lowest score
ENDS = {
    "as asked": (lambda n: {}, None, {}, "finished", 6, {}),
    "one given up": (lambda n: {"outcome": "abandoned"} if n == 1 else {}, None, {}, "finished", 5, {"given_up": 1}),
    "all given up": (lambda n: {"outcome": "abandoned", "steps": 1}, None, {}, "gave_up", 0, {"given_up": 6}),
    "the last instance by a bot": (lambda n: {**PROGRAM, "driver": "script"} if n == 5 else {}, None, {}, "partly_bot", 5,
                                  {"by_a_bot": 1}),
    "a first message lost": (lambda n: UNATTESTED if n == 2 else {}, None, {}, "not_attested", 6, {}),
    "every one flagged": (lambda n: {"labels": ("unfocused",)}, None, {}, "excluded", 6, {}),
    "all but one flagged": (lambda n: {"labels": ("unfocused",)} if n else {}, None, {}, "finished", 6, {}),
    "every one flagged or spoilt": (lambda n: {"attestation": "spoilt", "attestation_reason": "step 4: the move says no times"}
                                    if n == 1 else {"labels": ("no key-up",)}, None, {}, "excluded", 6, {}),
    "left": (lambda n: {}, first, LEFT, "left", 1, {"not_ended": 5}),
    "left at an episode": (lambda n: {"outcome": "abandoned", "ended_ms": CLOSED_MS}, first, LEFT, "left", 0, {"not_ended": 6}),
    "withdrew": (lambda n: {}, first, WITHDREW, "withdrew", 1, {"not_ended": 5}),
    "interrupted": (lambda n: {}, first, INTERRUPTED, "interrupted", 1, {"not_ended": 5}),
    "a failure": (lambda n: {"outcome": "environment_failed"}, first, LEFT, "failed", 0, {"failed": 1, "not_ended": 5}),
    "stopped": (lambda n: {"outcome": "abandoned"}, first, STOPPED, "stopped_by_rule", 0,
                {"not_ended": 5, "stopped_by_rule": 1}),
}  # fmt: skip


@pytest.mark.parametrize("end", ENDS)
def test_everybody_who_began_is_in_the_second_estimate_and_in_one_row_of_one_table(end):
    change, keep, who, status, as_played, lowest = ENDS[end]
    data = with_last(change, keep or (lambda number: True), **who)
    document = json.loads(build(data).to_json())
    (group,) = document["groups"]
    finished, everybody = group["figures"][:2]
    is_in = status == "finished"
    assert (finished["name"], finished["players"]) == ("per protocol", 3 + is_in)
    assert (everybody["name"], everybody["players"]) == ("everybody", 4)
    counted = [50.0] * as_played + [float(LIMIT)] * (TERRAINS - as_played)
    assert everybody["steps"]["mean"] == pytest.approx(np.mean([20, 30, 40, np.mean(counted)]))
    counted = [0.9] * as_played + [LOWEST] * (TERRAINS - as_played)
    assert everybody["score"]["mean"] == pytest.approx(np.mean([0.9, 0.9, 0.9, np.mean(counted)]))
    rows = {row["status"]: row for row in group["statuses"]}
    row = rows[status]
    assert row["in_per_protocol"] == is_in
    assert row["in_everybody"]
    assert row["lowest"] == lowest
    assert sum(counts["people"] for counts in rows.values()) == 4
    assert row["as_played"] == as_played + 18 * is_in
    assert group["flow"]["people"] == {name: counts["people"] for name, counts in rows.items()}
    honest = build(with_last(lambda number: {})).groups[0]
    assert everybody["steps"]["mean"] >= honest.everybody.steps.mean, "nothing is gained"
    cautions = [line for line in group["cautions"] if "not in the per-protocol estimate" in line]
    if is_in:
        assert not cautions
    else:
        means = f"{finished['steps']['mean']:.1f} steps", f"{everybody['steps']['mean']:.1f} steps"
        assert cautions[0].startswith("1 of 4 people who began")
        assert all(mean in cautions[0] for mean in means)
    assert not any("per-protocol estimate (" in line for line in honest.cautions)


def test_bots_and_those_who_never_began_are_in_neither_and_many_of_them_are_a_caution():
    people, trials = played(HONEST, steps=STEPS)
    bot, idle = person(7), person(8, completed=False, stage="warm_up")
    by_bot = [replace(trial(bot, number, 0.9, 11), **PROGRAM) for number in range(TERRAINS)]
    group = build(study([*people, bot, idle], [*trials, *by_bot])).groups[0]
    assert (group.figure.players, group.everybody.players) == (4, 4)
    assert {row.status: row.people for row in group.statuses} == {
        "finished": 4,
        "bot": 1,
        "never_began": 1,
    }
    (caution,) = (line for line in group.cautions if "in neither estimate" in line)
    assert caution.startswith("2 of 6 people who agreed are in neither estimate: 1 began no ranked")
    few = build(study([*people, idle], trials)).groups[0]
    assert not any("in neither estimate" in line for line in few.cautions), "a fifth is not more"


@pytest.mark.parametrize(("flagged", "is_said"), [(1, False), (6, True)])
def test_people_whose_every_episode_is_flagged_are_a_caution_where_they_move_the_second_estimate(
    flagged, is_said
):
    scores = np.full((12 + flagged, TERRAINS), 0.9)
    scores[12:] = 0.4
    people, trials = played(scores)
    doubtful = {person.id for person in people[12:]}
    trials = [
        replace(episode, labels=("unfocused",)) if episode.participant in doubtful else episode
        for episode in trials
    ]
    group = build(study(people, trials)).groups[0]
    assert (group.figure.players, group.everybody.players) == (12, 12 + flagged)
    cautions = [line for line in group.cautions if "data-quality flag" in line]
    assert bool(cautions) == is_said
    if is_said:
        assert cautions[0].startswith("6 people have a data-quality flag on every ranked episode")
        assert "mean score 0.733 with them, 0.900 without" in cautions[0]


@pytest.mark.parametrize(
    ("step", "status", "lowest"), [(4, "bot", {}), (5, "partly_bot", {"by_a_bot": 6})]
)
def test_whoever_makes_the_first_moves_of_one_episode_is_no_bot(step, status, lowest):
    """Handing episodes to a program once they go badly does not leave anybody out."""
    reason = f"step {step}: the move came from no key and no touch"
    spoilt = {"attestation": "spoilt", "driver": "script", "attestation_reason": reason}
    data = with_last(lambda number: spoilt)
    (row,) = (row for row in build(data).groups[0].statuses if row.status != "finished")
    assert (row.status, row.in_everybody, row.lowest) == (status, status != "bot", lowest)


def test_the_erased_move_no_mean_and_both_means_stand_as_they_could_be_with_them():
    people, trials = played(HONEST[:3], steps=STEPS)
    arrivals = Arrivals(
        erased=3,
        erased_after_closing=1,
        erased_began=2,
        erased_finishers=1,
        erased_asked_by={"participant": 1},
    )
    data = replace(study(people, trials), arrivals=arrivals)
    report = build(data)
    finished, everybody = report.groups[0].figure, report.groups[0].everybody
    assert finished.steps.mean == everybody.steps.mean == 30
    assert (finished.erased, everybody.erased) == (1, 2)
    assert finished.steps_range == pytest.approx(((90 + 1) / 4, (90 + LIMIT) / 4))
    assert everybody.steps_range == pytest.approx(((90 + 2) / 5, (90 + 2 * LIMIT) / 5))
    assert everybody.score_range == pytest.approx(((2.7 + 2 * LOWEST) / 5, (2.7 + 2) / 5))
    (caution,) = (line for line in report.groups[0].cautions if "erased" in line)
    assert caution.startswith(
        "2 people who had begun a ranked episode were erased; 1 of them had ended all."
    )
    assert "1 went after closing" in caution
    assert "asked for by: participant 1" in caution
    assert f"30.0 without them, {91 / 4:.1f} to {(90 + LIMIT) / 4:.1f}" in caution
    assert "erased" in render(report)
    honest = build(study(people, trials)).groups[0]
    assert not any("erased" in line for line in honest.cautions)


def lake(bounds, scores):
    """A study of an environment of negative scores, a person a row.

    None is an episode given up at -1.
    """
    task = f"gymnasium:{Description(id='FrozenLake-v1', bounds=bounds).told}"
    config = environment_of(task).default
    protocol = default_protocol("lake", config, task, ranked=3, players=len(scores))
    people, trials = [], []
    for number, row in enumerate(scores):
        who = person(number)
        people.append(who)
        for index, score in enumerate(row):
            end = ("abandoned", -1.0) if score is None else ("ended", score)
            ending = {
                "task": task,
                "config": config,
                "core_version": "",
                "outcome": end[0],
                "total": end[1],
            }
            trials.append(trial(who, index, end[1], **ending))
    data = study(people, trials)
    return replace(data, protocol=protocol, protocol_hash=protocol_hash(protocol))


@pytest.mark.parametrize("bounds", [(-200, 0), (None, None)])
def test_leaving_an_environment_of_negative_scores_gains_nothing(bounds):
    rows = [[-100.0, -120.0, -110.0], [-90.0, -100.0, -95.0], [-150.0, -180.0, -190.0]]
    honest = build(lake(bounds, rows)).groups[0]
    left = build(lake(bounds, [*rows[:2], [-150.0, None, -190.0]])).groups[0]
    if bounds == (None, None):
        assert honest.everybody.score is None, "there is no second estimate"
        assert left.figure.players == 2
        assert {row.status for row in left.statuses} == {"finished", "gave_up"}
        (caution,) = (line for line in left.cautions if "not in the per-protocol" in line)
        assert f"mean score {left.figure.score.mean:.3f}" in caution
        assert "No lowest score is declared" in build(lake(bounds, rows)).sentence
        return
    for metric in ("score", "steps"):
        gained = getattr(left.everybody, metric).mean - getattr(honest.everybody, metric).mean
        assert gained <= 0 if metric == "score" else gained >= 0
    assert left.figure.score.mean <= honest.figure.score.mean


def test_no_policy_is_tested_in_a_score_without_a_lowest_value():
    for bounds, primary, tested in (
        ((-200, 0), "score", ["ppo"]),
        ((None, None), "score", []),
        ((None, None), "steps", ["ppo"]),
    ):
        named = {"policies": ("ppo", "random"), "primary_metric": primary}
        protocol = lake(bounds, [[-1.0] * 3]).protocol.model_copy(update=named)
        assert policy_episodes.tested_policies(protocol) == tested


def test_a_study_without_a_fault_has_no_caution():
    people, trials = played(
        np.full((12, TERRAINS), 0.9), steps=np.arange(72).reshape(12, 6) % 23 + 20
    )
    assert not build(study(people, trials, players=12)).groups[0].cautions
