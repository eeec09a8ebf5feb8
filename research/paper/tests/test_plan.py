"""What the command does for each figure and budget."""

from pathlib import Path

import pytest

from research.paper.algorithms import ALGORITHMS
from research.paper.episodes.play import DIFFICULTIES
from research.paper.plan import BUDGETS, FIGURES, LEVEL, Request, disagreement, is_full, plan
from research.paper.tests.logs import trial_of, write_trial
from research.paper.trial import Trial

NOWHERE = Path("nowhere")


def test_figure_4_is_four_algorithms_in_two_variants_with_seed_0_first():
    jobs = plan(Request(("4",)), NOWHERE)
    assert len(jobs) == 24
    assert {(job.algorithm, job.variant) for job in jobs[:8]} == {
        (name, variant) for name in ALGORITHMS for variant in ("paper", "works")
    }
    assert [job.seed for job in jobs] == [0] * 8 + [1] * 8 + [2] * 8
    assert len({job.name for job in jobs}) == 24


def test_figure_5_is_ppo_on_the_12_levels():
    jobs = [job for job in plan(Request(("5",)), NOWHERE) if hasattr(job, "algorithm")]
    assert {(job.algorithm, job.variant) for job in jobs} == {("ppo", "paper")}
    assert [job.level for job in jobs[:12]] == list(DIFFICULTIES)
    assert [job.seed for job in jobs] == [0] * 12 + [1] * 12 + [2] * 12


@pytest.mark.parametrize("budget", BUDGETS)
def test_every_budget_has_every_figure_and_all_but_small_are_full(budget):
    jobs = plan(Request(FIGURES, budget), NOWHERE)
    trials = [job for job in jobs if isinstance(job, Trial)]
    assert {(trial.level == LEVEL, is_full(trial)) for trial in trials} == {
        (is_figure_4, budget != "small") for is_figure_4 in (True, False)
    }
    assert len(jobs) > len(trials)


def test_options_stand_in_place_of_the_budgets():
    (job,) = plan(
        Request(
            ("4",), algorithms=("sac",), variants=("works-no-mask",), seeds=1, moves=7, terrains=5
        ),
        NOWHERE,
    )
    assert (job.algorithm, job.variant, job.moves, job.terrains) == ("sac", "works-no-mask", 7, 5)
    with pytest.raises(ValueError, match="no algorithm 'dqn'; choose of: a2c, ppo, rainbow, sac"):
        plan(Request(("4",), algorithms=("dqn",)), NOWHERE)


def test_a_folder_with_other_trials_is_refused_and_one_with_more_seeds_is_not(tmp_path):
    write_trial(tmp_path, trial_of(moves=1000), [0.1, 0.2])
    more = [trial_of(seed=1), trial_of()]
    assert disagreement(more, tmp_path) is None
    sentence = disagreement([trial_of(seed=1, moves=2000), trial_of(moves=2000)], tmp_path)
    assert "begun with 1,000 moves and 10 terrains, and 2,000 and 10 are asked for" in sentence
