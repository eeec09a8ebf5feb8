"""No figure of a report depends on what participants are called."""

from dataclasses import replace

import numpy as np

from humanplay.report.build import build
from humanplay.report.statistics.exclusion_sets import members, people_of
from tests.support.made_studies import played, run, study


def renamed(people, trials, names):
    """Return the same people and trials under other ids."""
    return [replace(person, id=names[person.id]) for person in people], [
        replace(trial, participant=names[trial.participant]) for trial in trials
    ]


def test_pseudonyms_move_no_end_of_an_interval():
    scores = np.random.default_rng(5).normal(0.7, 0.1, (8, 6)).clip(0, 1)
    people, trials = played(scores)
    runs = [run("ppo", scores.mean(0) + 0.05), run("random", [0.2] * 6)]
    report = build(study(people, trials), runs)
    for seed in range(3):
        drawn = np.random.default_rng(seed).permutation(8)
        names = {person.id: f"{number:032x}" for person, number in zip(people, drawn, strict=True)}
        other = build(study(*renamed(people, trials, names)), runs)
        assert other.groups == report.groups


def test_the_order_of_players_is_that_of_what_they_played():
    people, trials = played([[0.9, 0.1], [0.2, 0.8], [0.9, 0.0]], steps=[[20, 20]] * 3)
    cohort = people_of(study(people, trials, ranked=2))
    assert members(cohort, {}) == [people[1].id, people[2].id, people[0].id]
