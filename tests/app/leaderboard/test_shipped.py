"""The shipped figures are complete, exact, and used for nothing else."""

import json
from functools import cache

import numpy as np
import pytest

from humanplay.jobs import Jobs
from humanplay.results.entries import make_board, make_figure, offered_boards
from humanplay.results.evaluations import (
    FOLDER,
    Evaluation,
    ShippedFigures,
    file_name,
    to_document,
)
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import steps_to_target
from marsexplorer.evaluation.episodes import play_episode

TINY = EnvConfig("random", 5, 7)
COMMAND = "humanplay leaderboard"


@cache
def sizes():
    return {name: getattr(policies.load(name), "size", None) for name in policies.names()}


def jobs_of(entry):
    """The policies that play a board: a network made for one size plays no other."""
    size = (entry.config.rows, entry.config.cols)
    names = [name for name, only in sizes().items() if only in (None, size)]
    return list(entry.evaluations(dict(zip(names, names, strict=True))).values())


@pytest.mark.parametrize("board", offered_boards())
def test_every_board_on_offer_has_a_figure_of_every_shipped_policy(board):
    entry = offered_boards()[board]
    shipped = ShippedFigures()
    for job in jobs_of(entry):
        figure = shipped.find(job)
        command = f"humanplay leaderboard --board {board} --out data/leaderboard"
        assert figure is not None, f"run `{command}`"
        assert figure.command == command
        assert (figure.figure["episodes"], len(figure.steps)) == (
            len(entry.seeds),
            len(entry.seeds),
        )
        assert figure.figure["steps"]["mean"] == np.mean(figure.steps)
        assert np.shape(figure.figure["visits"]) == (entry.config.rows, entry.config.cols)


@pytest.mark.parametrize("board", ["random-21x21", "1-2-1-21x21", "3-2-2-21x21"])
def test_the_first_terrains_are_played_again_to_the_same_step(board):
    entry = offered_boards()[board]
    for job in jobs_of(entry):
        policy = policies.load(job.policy, entry.config.sensor_radius)
        played = [play_episode(policy, entry.config, seed) for seed in job.seeds[:3]]
        again = [
            steps_to_target(episode.config, episode.outcome, episode.steps) for episode in played
        ]
        assert tuple(again) == ShippedFigures().find(job).steps[:3], job.policy


def test_a_whole_figure_is_made_again_to_the_last_digit():
    jobs = jobs_of(offered_boards()["random-21x21"])
    job = next(candidate for candidate in jobs if candidate.policy == "frontier-cost")
    shipped = ShippedFigures().find(job)
    figure = make_figure(job, shipped.command)
    assert json.loads(json.dumps(figure.figure)) == shipped.figure
    assert figure == shipped


@pytest.mark.long
@pytest.mark.parametrize("board", [board for board in offered_boards() if board.endswith("21x21")])
def test_a_file_is_made_again_as_it_is(board):
    entry = offered_boards()[board]
    with Jobs(2) as jobs:
        text = make_board(entry, jobs, lambda done, of: None)
    shipped_text = (FOLDER / file_name(entry.config)).read_text()
    assert text == shipped_text


def test_a_figure_is_used_for_its_own_terrains_policy_and_core_alone(tmp_path):
    job = Evaluation("frontier-cost", TINY, (1, 2))
    figure = make_figure(job, COMMAND)
    path = tmp_path / file_name(TINY)
    document = to_document(TINY, job.seeds, [figure], COMMAND)
    path.write_text(document)
    assert ShippedFigures(tmp_path).find(job) == figure
    short = EnvConfig("random", 5, 7, max_steps=9)
    for other in (
        ("frontier-cost", TINY, (1, 3)),
        ("frontier-cost", short, (1, 2)),
        ("random", TINY, (1, 2)),
    ):
        assert ShippedFigures(tmp_path).find(Evaluation(*other)) is None, other
    for changed in ('"core_version": "0"', '"file_sha256":"of another file"'):
        name = changed.partition(":")[0]
        old = next(part for part in (f'{name}: "1"', f"{name}:null") if part in document)
        path.write_text(document.replace(old, changed))
        assert ShippedFigures(tmp_path).find(job) is None, changed


def test_the_first_visit_shows_a_full_board_without_people(serve):
    shown = serve().client().get("/api/leaderboard/random-21x21").json()
    assert [policy["state"] for policy in shown["policies"]] == ["ready"] * len(policies.names())
    assert all("leaderboard" in policy["shipped"]["command"] for policy in shown["policies"])
    assert shown["people"] is None
