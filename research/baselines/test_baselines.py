"""Rules from elsewhere do what is written of them, all on the same terrains."""

import math
from collections import Counter
from itertools import combinations, pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.config import UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.kernels.grid import grid_scratch
from marsexplorer.policies.kernels.visibility import VisibilityMap
from research.baselines import __main__ as command
from research.baselines import rules
from research.baselines.kernels import find_clusters, measure_between, order_tour
from research.baselines.rules import ClusterTour, DistanceAdvantage, NextBestView, USweep, lanes
from research.difference.picture import VIDEOS
from research.paper.jobs import read_lines
from tests.support.reference_frontier import distances, expected_discoveries


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


def worths(codes, visited, rover, discount):
    """Viewpoint -> what it shows, discounted by its distance."""
    return {
        cell: expected_discoveries(codes, *cell, 3) * math.exp(-discount * moves)
        for cell, moves in distances(codes, rover).items()
        if cell not in visited
    }


@pytest.mark.parametrize(
    ("rule", "measure", "side"),
    [
        *((DistanceAdvantage(weight, 3), advantages, 15) for weight in (0.0, 0.5, 1.0)),
        *((NextBestView(discount, 3), worths, 9) for discount in (0.0, 0.1, 0.4)),
    ],
    ids=lambda argument: getattr(argument, "name", None),
)
def test_it_goes_where_there_is_most(rule, measure, side, monkeypatch):
    """So many viewpoints are drawn that none is left out."""
    monkeypatch.setattr(rules, "SAMPLES", 5000)
    strength = rule.weight if measure is advantages else rule.discount
    config = EnvConfig("random", side, side, sensor_radius=3)
    for seed in range(3):
        episode = Episode.begin(config, seed=seed)
        rule.reset(seed)
        while not episode.ended:
            codes, rover = episode.codes.copy(), episode.position
            visited = {(row, col) for row, col in episode.path}
            wanted = measure(codes, visited, rover, strength)
            goals = [cell for cell in wanted if wanted[cell] > max(wanted.values()) - 1e-9]
            episode.step(rule.act(episode.codes))
            nearer = distances(codes, episode.position)
            before = distances(codes, rover)
            assert any(nearer[goal] == before[goal] - 1 for goal in goals)
        assert episode.outcome == "explored"


@pytest.mark.parametrize("rule", [NextBestView(), ClusterTour()], ids=lambda rule: rule.name)
def test_a_rule_completes_terrains_and_repeats_itself_by_its_seed(rule):
    for config in (EnvConfig(), EnvConfig.of("2-2-1", 42)):
        for seed in range(3):
            episode = play_episode(rule, config, seed)
            assert episode.outcome == "explored"
            assert [*play_episode(rule, config, seed).path] == [*episode.path]


def test_a_next_best_view_draws_by_its_seed():
    paths = set()
    for seed in range(3):
        episode, rule = Episode.begin(EnvConfig(), seed=0), NextBestView()
        rule.reset(seed)
        while not episode.ended:
            episode.step(rule.act(episode.codes))
        paths.add(tuple(map(tuple, episode.path)))
    assert len(paths) == 3


def touch(one, other):
    return max(abs(one[0] - other[0]), abs(one[1] - other[1])) == 1


def cluster_of(stop, cells, reach):
    """The cells connected with a stop in at most so many steps."""
    cluster, edge = {stop}, {stop}
    for _ in range(reach):
        edge = {cell for cell in cells - cluster if any(touch(cell, last) for last in edge)}
        cluster |= edge
    return cluster


def test_a_tour_begins_at_a_cluster_of_connected_frontier_cells_where_most_is_seen():
    config = EnvConfig("random", 15, 15, sensor_radius=3)
    scratch, view = grid_scratch((15, 15)), VisibilityMap((15, 15), 3).view
    shown, candidates, stops = np.zeros((3, 256), np.int32)
    episode, rule = Episode.begin(config, seed=4), ClusterTour(3)
    rule.reset(4)
    most = known_cells = 0
    while not episode.ended:
        codes, rover = episode.codes.copy(), episode.position
        visited = np.zeros((15, 15), np.uint8)
        visited[tuple(np.transpose(episode.path))] = 1
        flat = rover[0] * 15 + rover[1]
        count = find_clusters(codes, visited, flat, 3, view, scratch, shown, candidates, stops)
        left = {
            cell: expected_discoveries(codes, *cell, 3)
            for cell in distances(codes, rover)
            if not visited[cell] and is_frontier(codes, cell)
        }
        left = {cell: number for cell, number in left.items() if number}
        for stop in (divmod(int(cell), 15) for cell in stops[1 : count + 1]):
            assert left[stop] == max(left.values())
            left = {cell: left[cell] for cell in left.keys() - cluster_of(stop, left.keys(), 3)}
        assert not left
        between = np.zeros((count + 1, count + 1), np.int32)
        measure_between(codes, count, stops, scratch, between)
        moves = distances(codes, rover)
        assert [moves[divmod(int(stop), 15)] for stop in stops[: count + 1]] == between[0].tolist()
        assert (between == between.T).all()
        tour, gaps = np.zeros((2, count + 1), np.int32)
        order_tour(count, between, tour, gaps)
        episode.step(rule.act(episode.codes))
        if np.count_nonzero(codes) > known_cells:
            first = divmod(int(stops[tour[0]]), 15)
            assert distances(codes, episode.position)[first] == moves[first] - 1
        most, known_cells = max(most, count), np.count_nonzero(codes)
    assert most > 3


def length_of(tour, between):
    return sum(between[one, other] for one, other in pairwise([0, *tour]))


def test_a_tour_visits_all_and_no_stretch_of_it_is_better_reversed():
    generator = np.random.default_rng(0)
    ratios = []
    for count in [1, 2, *[7] * 40]:
        places = generator.integers(0, 40, (count + 1, 2))
        between = np.abs(places[:, None] - places).sum(axis=2).astype(np.int32)
        tour, gaps = np.zeros((2, count + 1), np.int32)
        order_tour(count, between, tour, gaps)
        stops = tour[:count].tolist()
        assert sorted(stops) == [*range(1, count + 1)]
        length = length_of(stops, between)
        for low, high in combinations(range(count), 2):
            turned = stops[:low] + stops[low : high + 1][::-1] + stops[high + 1 :]
            assert length_of(turned, between) >= length
        ratios.append(length / min(length_of(tour, between) for tour in permutations(stops)))
    assert np.mean(ratios) < 1.05


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
    seed, stored = next(iter(command.read_rows(command.file_of(21))[name].items()))
    row = command.row_of(rule, EnvConfig.of("random", 21), seed)
    assert row == (seed, name, stored.steps, f"{stored.soon:.4f}")


def test_a_rule_that_is_new_plays_what_the_others_have_played(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "FOLDER", tmp_path)
    arguments = ["--size", "9", "--terrains", "3"]
    CliRunner().invoke(command.main, arguments)
    path = tmp_path / "random-9.csv"
    whole = path.read_text().splitlines()
    path.write_text("\n".join(line for line in whole if ",cluster-tour," not in line) + "\n")
    table = CliRunner().invoke(command.main, ["--size", "9", "--table"]).output
    assert "cluster-tour" not in table
    assert "| `next-best-view` | 9x9 | 3 |" in table
    CliRunner().invoke(command.main, arguments)
    assert sorted(path.read_text().splitlines()) == sorted(whole)


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
