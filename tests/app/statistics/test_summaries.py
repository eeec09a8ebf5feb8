"""Summaries of episodes: curves, visits and trials; every group weighs the same."""

import numpy as np
import pytest
import scipy

from humanplay.report.statistics.summaries import (
    EpisodeSummary,
    coverage_curve,
    summarize_episodes,
    trial_summaries,
    visit_counts,
)
from marsexplorer.config import EnvConfig

TINY = EnvConfig("random", 5, 7)


def episode(discoveries, path=((0, 0), (0, 1)), steps=9, score=0.5, succeeded=True):
    return EpisodeSummary(succeeded, score, steps, discoveries, path, TINY.n)


def test_a_curve_is_the_mean_over_groups_and_an_ended_episode_keeps_what_it_had():
    summary = coverage_curve([[episode([7, 14]), episode([7, 21])], [episode([7, 7, 35])]])
    assert summary["steps"] == [0, 1, 2]
    first, second = np.array([7, 17.5, 17.5]) / 35, np.array([7, 7, 35]) / 35
    assert summary["mean"] == pytest.approx((first + second) / 2, abs=1e-4)
    low, high = scipy.stats.t.interval(
        0.95, 1, loc=(first[2] + second[2]) / 2, scale=scipy.stats.sem([first[2], second[2]])
    )
    assert (summary["low"][2], summary["high"][2]) == pytest.approx((low, high), abs=1e-4)
    alone = coverage_curve([[episode([7, 14])]])
    assert (alone["low"], alone["high"]) == ([], []), "one group gives no interval"


def test_visits_count_every_move_and_leave_out_what_lies_off_the_grid():
    counts = np.array(
        visit_counts(
            TINY.size,
            [[episode([1], [(0, 0), (0, 1), (0, 0), (-1, 0)])], [episode([1], [(0, 0), (4, 6)])]],
        )
    )
    assert counts.shape == (5, 7)
    assert (counts[0, 0], counts[0, 1], counts[4, 6], counts.sum()) == (1.5, 0.5, 0.5, 2.5)


def test_trials_name_the_number_of_people_behind_each_point():
    summary = trial_summaries(
        [[episode([1], steps=10), episode([1], steps=8)], [episode([1], steps=20)]]
    )
    assert [(trial["trial"], trial["players"], trial["steps"]["mean"]) for trial in summary] == [
        (1, 2, 15.0),
        (2, 1, 8.0),
    ]
    assert summary[1]["steps"]["low"] is None


def test_the_unit_of_a_figure_is_the_group():
    summary = summarize_episodes(
        TINY,
        [
            [episode([1], steps=10), episode([1], steps=20, succeeded=False)],
            [episode([1], steps=30)],
        ],
    )
    assert (
        summary["groups"],
        summary["episodes"],
        summary["steps"]["mean"],
        summary["completed"],
    ) == (
        2,
        3,
        22.5,
        0.75,
    )
