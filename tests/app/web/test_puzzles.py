"""The puzzles of a day: positions first, their answers on request."""

import json
from itertools import pairwise

import pytest

from humanplay.results.puzzles import A_DAY, puzzles_of, puzzles_on
from humanplay.study.seeds import TUTORIAL_SEED
from humanplay.task.registration import environment_of
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.evaluation import effort, puzzles
from marsexplorer.training.envs import EVALUATION_SEEDS

DAY = "2027-02-01"


def test_today_has_three_positions_and_no_answer(serve):
    client = serve().client()
    today = client.get("/api/puzzles").json()
    assert len(today["puzzles"]) == A_DAY
    assert 0 < today["next_ms"] - today["now_ms"] <= 86_400_000
    for puzzle in today["puzzles"]:
        assert set(puzzle) == {"id", "frame", "trail", "moves"}
        answer = client.get(f"/api/puzzles/{puzzle['id']}/answer").json()
        assert answer["best"] in puzzle["moves"]
        frame = puzzle["frame"]
        row, col = frame["position"]
        assert frame["grid"][row][col] == "@"
        assert len(puzzle["trail"]) == frame["step"] + 1
        assert all(abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in pairwise(puzzle["trail"]))
    assert client.get("/api/puzzles/none/answer").status_code == 404


def test_each_day_has_others_until_all_have_been_shown():
    shown = [
        puzzle.id for day in range(1, 29) for puzzle in puzzles_on("mars", f"2027-02-{day:02}")
    ]
    count = min(len(shown), len(puzzles_of("mars")))
    assert len(set(shown[:count])) == count
    assert puzzles_on("gymnasium", DAY) == []


def test_an_environment_with_a_long_description_has_no_puzzles():
    assert puzzles_on("gymnasium:" + json.dumps({"instructions": "Go on. " * 40}), DAY) == []
    assert puzzles_on("../puzzles/mars", DAY) == []


def test_every_shipped_puzzle_has_one_clear_answer():
    for puzzle in puzzles_of("mars").values():
        best, means, saves, error, terrains, _, shows = puzzle.answer
        others = [moves for action, moves in means.items() if action != best]
        assert set(means) <= set(ACTIONS)
        assert len(others) >= 1
        assert terrains >= 32
        assert min(others) - means[best] == pytest.approx(saves, abs=0.02)
        assert saves >= 6
        assert saves > 2 * error
        assert set(shows) == set(means)
        grid = puzzle.frame["grid"]
        assert all(grid[row][col] == "?" for cells in shows.values() for row, col in cells)


def test_their_terrains_are_hardly_drawn_by_anything_else():
    boards = environment_of("mars").boards
    offered = {seed for config in boards.offered for seed in boards.seeds(config)}
    others = {TUTORIAL_SEED, *offered, effort.FIRST_SEED, effort.FIRST_SEED + effort.EPISODES}
    others |= {EVALUATION_SEEDS.start, EVALUATION_SEEDS.stop - 1}
    assert not others & set(puzzles.SEEDS)
    # ranked, daily and study terrains are drawn from all seeds
    assert 2**53 // (len(puzzles.SEEDS) * 10**6) == 9007, "one in nine thousand million"


def test_the_first_of_the_file_is_made_again():
    puzzle = next(filter(None, map(puzzles.puzzle_on, puzzles.SEEDS)))
    (shipped,) = list(puzzles_of("mars").values())[:1]
    assert puzzle.trail == tuple(map(tuple, shipped.trail))
    assert puzzle.answer == shipped.answer.best
    assert puzzle.shows == {
        move: list(map(tuple, cells)) for move, cells in shipped.answer.shows.items()
    }
    assert puzzle.saves == pytest.approx(shipped.answer.saves, abs=0.006)
    assert EnvConfig.of("random", 21) == puzzles.CONFIG
