"""Rules from elsewhere do what is written of them, all on the same terrains."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.config import UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from research.baselines import __main__ as command
from research.baselines.rules import DistanceAdvantage, USweep, lanes
from research.difference.picture import VIDEOS
from research.paper.jobs import read_lines
from tests.support.reference_frontier import distances


def is_frontier(codes, cell):
    row, col = cell
    return (codes[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2] == UNKNOWN).any()


def advantages(codes, visited, rover, weight):
    """Candidate -> advantage, as the module's docstring has it."""
    from_rover = distances(codes, rover)
    by_candidate = {}
    for cell, moves in from_rover.items():
        if cell not in visited and is_frontier(codes, cell):
            by_candidate[cell] = weight * np.mean([*distances(codes, cell).values()]) - moves
    return by_candidate


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_it_goes_where_the_advantage_is_largest(weight):
    rule = DistanceAdvantage(weight, 3)
    config = EnvConfig("random", 15, 15, sensor_radius=3)
    for seed in range(3):
        episode = Episode.begin(config, seed=seed)
        rule.reset(seed)
        while not episode.ended:
            codes, rover = episode.codes.copy(), episode.position
            visited = {(row, col) for row, col in episode.path}
            wanted = advantages(codes, visited, rover, weight)
            goals = [cell for cell in wanted if wanted[cell] > max(wanted.values()) - 1e-9]
            episode.step(rule.act(episode.codes))
            nearer = distances(codes, episode.position)
            before = distances(codes, rover)
            assert any(nearer[goal] == before[goal] - 1 for goal in goals)
        assert episode.outcome == "explored"


def rows_driven(path):
    """The rows along which a path goes for more than half of the grid's 21 columns."""
    moves = Counter(row for (row, _), (next_row, _) in pairwise(path) if row == next_row)
    return sorted(row for row, count in moves.items() if count > 21 / 2)


def test_the_sweep_drives_the_rows_of_the_videos():
    corners = [*lanes(21, 21, 6)]
    assert corners == [(6, 6), (6, 14), (14, 14), (14, 6)]
    for video in read_lines(VIDEOS):
        assert rows_driven(video["path"]) == sorted({row for row, _ in corners})


def test_the_lanes_of_other_grids_are_no_further_apart_than_the_lidar_sees():
    rows = [row for row, _ in lanes(84, 84, 6)][::2]
    assert (rows[0], rows[-1], max(np.diff(rows))) == (6, 77, 12)
    assert [*lanes(5, 5, 6)] == [(2, 2), (2, 2)]


def test_the_sweep_drives_its_lanes_and_then_explores():
    config = EnvConfig()
    episode, rule = Episode.begin(config, terrain=np.zeros((21, 21), bool)), USweep()
    rule.reset(0)
    while not episode.ended:
        episode.step(rule.act(episode.codes))
    path = [(row, col) for row, col in episode.path]
    ends = [path.index(end) for end in lanes(21, 21, 6) if end in path]
    assert len(ends) >= 3
    assert ends == sorted(ends)
    assert all(play_episode(USweep(), config, seed).outcome == "explored" for seed in range(10))


def test_the_page_of_results_has_the_stored_table():
    page = (Path(__file__).parents[2] / "docs" / "results.md").read_text()
    rows = [
        "|".join(cell.strip() for cell in line.split("|")) for line in command.table().splitlines()
    ]
    assert "\n".join(rows) in page


@pytest.mark.parametrize("name", command.NAMES)
def test_a_stored_terrain_is_played_again_as_it_is_stored(name):
    (rule,) = (rule for rule in command.players() if rule.name == name)
    seeds, moves, shares = command.steps_by_seed(command.file_of(21))
    row = command.row_of(rule, EnvConfig.of("random", 21), seeds[0])
    assert row == (seeds[0], name, moves[name][0], f"{shares[name][0]:.4f}")


def test_a_run_that_was_stopped_goes_on_and_prints_ratios(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "FOLDER", tmp_path)
    first = CliRunner().invoke(command.main, ["--size", "9", "--terrains", "2"])
    assert first.exit_code == 0, first.output
    lines = (tmp_path / "random-9.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * len(command.players())
    second = CliRunner().invoke(command.main, ["--size", "9", "--terrains", "3"])
    assert (tmp_path / "random-9.csv").read_text().splitlines()[: len(lines)] == lines
    (best,) = (line for line in second.output.splitlines() if "`frontier-priced`" in line)
    assert best.split(" | ")[1:3] == ["9x9", "3"]
    assert best.split(" | ")[5] == "1"
    rules = [line for line in second.output.splitlines() if "| `frontier-" in line]
    assert [line.split(" | ")[4] for line in rules].count("1") == 1
    table = CliRunner().invoke(command.main, ["--size", "9", "--table"])
    assert table.output.strip() in second.output
