"""Pictures of an evaluation show what was played, with the same bytes each time."""

from dataclasses import replace

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.evaluation.plots import (
    coverage_curves,
    coverage_figure,
    heat_figure,
    heat_maps,
    save_plots,
)
from marsexplorer.terrain import generate

CONFIGS = (EnvConfig("random", 7, 11, sensor_radius=3), EnvConfig("1-1-1", 7, 11, sensor_radius=3))


@pytest.fixture(scope="module")
def table():
    return evaluate(["frontier-cost", "random"], CONFIGS, 3, 4, traces=True)


def test_curves_begin_at_the_first_look_and_stay_where_the_episode_ended(table):
    results = table.results[:3]
    curves = coverage_curves(results, 60)
    assert curves.shape == (3, 61)
    assert (np.diff(curves, axis=1) >= 0).all()
    for curve, result in zip(curves, results, strict=True):
        assert curve[0] == result.trace.discovered[0] / 77 > 1 / 77
        assert (curve[result.steps :] == result.coverage).all()
        assert curve[result.steps - 1] < CONFIGS[0].target / 77


def test_heat_maps_count_moves_and_obstacles_found(table):
    results = table.results[:3]
    visits, obstacles = heat_maps(results, CONFIGS[0])
    assert visits.sum() == sum(result.steps + 1 for result in results)
    assert visits[0, 0] >= 3
    true = sum(generate(CONFIGS[0], seed).astype(int) for seed in (4, 5, 6))
    assert (obstacles <= true).all()
    assert obstacles.sum() > 0.8 * true.sum()


def test_a_coverage_plot_ends_with_the_explored_and_names_every_policy(table):
    axes = coverage_figure(table, CONFIGS[0]).axes[0]
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["frontier-cost", "random"]
    longest = max(result.steps for result in table.results[:6] if result.outcome == "explored")
    assert axes.get_xlim() == (0, longest)
    assert len(heat_figure(table, "random").axes) == 2


def test_the_same_table_gives_the_same_files_and_needs_traces(table, tmp_path):
    first, second = save_plots(table, tmp_path / "a"), save_plots(table, tmp_path / "b")
    assert [path.name for path in first] == [
        "coverage-random-7x11.png",
        "coverage-1-1-1-7x11.png",
        "heat-frontier-cost.png",
        "heat-random.png",
    ]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert {path.name for path in (tmp_path / "a").iterdir()} == {path.name for path in first}
    alike = [replace(CONFIGS[0], sensor_radius=radius) for radius in (2, 3)]
    both = evaluate(["random"], alike, 2, 0, traces=True)
    assert [path.name for path in save_plots(both, tmp_path / "c")] == [
        "coverage-random-7x11.png",
        "coverage-random-7x11-2.png",
        "heat-random.png",
    ]
    without = evaluate(["random"], CONFIGS[0], 2, 0)
    with pytest.raises(ValueError, match="traces=True"):
        save_plots(without, tmp_path)
