"""The search of the informed planner equals walking the whole tour."""

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from research.informed import convergence
from research.informed.annealing import empty_legs, replace_legs, walk_changed_legs
from research.informed.informed import (
    AnnealingConfig,
    KnownTerrain,
    informed_actions,
    informed_paths,
)
from research.informed.tours import change_tour, copy_tour, walk_tour

CONFIG = EnvConfig("random", 9, 23, sensor_radius=3)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_changed_tour_is_as_long_and_shows_as_much_as_when_it_is_walked_whole(seed):
    terrain = KnownTerrain(CONFIG, generate(CONFIG, seed))
    start, capacity, words = 0, 40, terrain.words
    points, tie_breaks = np.zeros((2, capacity), np.int32), np.zeros((2, capacity), np.int8)
    legs, proposed = empty_legs(capacity, words)
    covered, whole = np.zeros((2, words), np.uint64), np.zeros(words, np.uint64)
    path, state = np.zeros(8 * CONFIG.n, np.int32), np.array([seed], np.uint64)
    covered[0] = legs[3][0] = terrain.views[start]
    rng, count, length, accepted = np.random.default_rng(seed), 0, 0, 0
    for _ in range(600):
        copy_tour(points, tie_breaks, 0, 1, count)
        args = (points[1], tie_breaks[1], count, covered[0], terrain.arrays, terrain.free)
        new_count = change_tour(start, *args, CONFIG.n, state)
        if new_count < 0:
            continue
        counts = (count, new_count)
        args = (terrain.arrays, legs, proposed, covered[1])
        first, end, longer = walk_changed_legs(start, points, tie_breaks, counts, *args)
        walked = (points[1], tie_breaks[1], new_count, terrain.arrays, whole, path)
        assert length + longer == walk_tour(start, *walked)
        assert (covered[1] == whole).all()
        if rng.random() < (0.9 if new_count > count else 0.4):
            replace_legs(counts, first, end, legs, proposed)
            copy_tour(points, tie_breaks, 1, 0, new_count)
            covered[0] = covered[1]
            count, length, accepted = new_count, length + longer, accepted + 1
    assert accepted > 100
    assert count > 5


def test_a_terrain_has_the_walk_that_the_published_figures_were_made_with():
    config = EnvConfig()
    searched = AnnealingConfig(60_000, 1)
    walks = [informed_actions(config, generate(config, seed), seed, searched) for seed in (5, 6)]
    assert [*map(len, walks)] == [57, 53]


def test_the_table_of_convergence_has_a_line_for_each_budget():
    arguments = "--size 9 --episodes 2 --seed 7 --searches 2 --changes 400 --changes 3000"
    printed = CliRunner().invoke(convergence.main, arguments.split()).output
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in printed.splitlines()[2:]]
    assert [row[0] for row in rows] == ["400", "3,000"]
    config = EnvConfig.of("random", 9)
    for row in rows:
        searched = AnnealingConfig(int(row[0].replace(",", "")), 2)
        walks = [informed_paths(config, generate(config, seed), seed, searched) for seed in (7, 8)]
        lengths = np.array([[len(path) - 1 for path in paths] for paths in walks])
        assert row[1] == ", ".join(f"{mean:.1f}" for mean in lengths.mean(0))
        assert row[2].startswith(f"{lengths.min(1).mean():.1f} ± ")
    assert rows[0][3] == ""
    refused = CliRunner().invoke(convergence.main, ["--size", "200"])
    assert "up to 16384 cells" in refused.output
