"""Figures 6 and 7 equal a count by hand, and their jobs go on after a stop."""

import json
import pickle
import shutil
from collections import Counter
from itertools import product

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.policies import find_file
from marsexplorer.terrain import generate
from research.informed.informed import INFORMED
from research.paper.claims.results import FOLDER
from research.paper.episodes.play import DIFFICULTIES, FIRST_SEED, can_play, gather, read_results
from research.paper.episodes.quadrants import (
    Visits,
    course_rates,
    has_free_neighbour,
    map_of,
    obstacles_of,
)
from research.paper.episodes.scale import PER_CENT, compare, scale_rows, steps_of
from research.paper.episodes.walks import NULLS
from research.paper.figures import figure6, figure7
from research.paper.figures.drawing import FIXED_COLOURS, colours_of, save
from research.paper.jobs import read_lines

SIZE, EPISODES = 9, 4
SEEDS = range(FIRST_SEED, FIRST_SEED + EPISODES)


def nothing(share):
    pass


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """The jobs of both figures on small grids, done."""
    folder = tmp_path_factory.mktemp("played")
    rules = ["frontier-cost", "frontier-utility"]
    jobs = figure6.jobs(rules, ["1-1-1", "2-2-1"], EPISODES, SIZE)[: 2 * 2]
    jobs += figure7.jobs([*rules, "random", INFORMED], ["random"], [SIZE], EPISODES)
    for job in jobs:
        pickle.loads(pickle.dumps(job)).run(folder, nothing)
        assert job.is_done(folder)
    return folder


def test_no_terrain_of_the_figures_is_one_that_training_may_see():
    from marsexplorer.training.envs import EVALUATION_SEEDS

    assert set(SEEDS) < set(EVALUATION_SEEDS)


def test_the_maps_count_what_an_evaluation_of_the_same_terrains_shows(played):
    config = EnvConfig.of("2-2-1", SIZE)
    results = evaluate(["frontier-cost"], config, seeds=SEEDS, traces=True).results
    lines = read_results(played, 6)
    (line,) = (one for one in lines if (one["policy"], one["level"]) == ("frontier-cost", "2-2-1"))
    on_cell = Counter(cell for result in results for cell in result.trace.path)
    assert line["visits"] == [on_cell[cell] for cell in range(81)]
    drawn = sum(generate(config, seed).astype(int) for seed in SEEDS)
    assert map_of(line, "drawn").tolist() == drawn.tolist()
    seen = Counter(cell for result in results for cell in result.trace.obstacles)
    assert line["found"] == [seen[cell] for cell in range(81)]
    assert (map_of(line, "found") <= map_of(line, "discoverable")).all()
    assert (map_of(line, "discoverable") <= map_of(line, "drawn")).all()
    assert len(line["courses"]) == line["played"] == EPISODES
    assert line["outcomes"] == Counter(result.outcome for result in results)
    assert line["steps"] == pytest.approx(np.mean([result.steps for result in results]), abs=0.01)


def test_an_obstacle_among_obstacles_cannot_be_discovered():
    terrain = np.zeros((6, 5), bool)
    terrain[0:3, 0:3] = True
    for with_corners in (True, False):
        hidden = np.argwhere(terrain & ~has_free_neighbour(terrain, with_corners))
        assert hidden.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    terrain[3, 2] = True
    by_sides, with_corners = (has_free_neighbour(terrain, corners) for corners in (False, True))
    assert not by_sides[2, 1:].any() or with_corners[2, 2]


def test_a_blind_spot_is_a_cell_where_most_obstacles_are_missed():
    drawn, discovered = [0, 10, 4, 10, 10, 10], [0, 10, 0, 4, 5, 10]
    line = {"rows": 2, "cols": 3, "drawn": drawn, "discoverable": drawn, "found": discovered}
    obstacles = obstacles_of(line)
    # cell 2 has too few obstacles to say so, and half of those on cell 4 were found
    assert obstacles.blind_spots == (3,)
    assert obstacles.found_share == 29 / 44
    moved = sum(abs(a / 44 - b / 29) for a, b in zip(drawn, discovered, strict=True)) / 2
    assert obstacles.distance == pytest.approx(moved)


def test_curves_and_moves_to_shares_equal_those_of_an_evaluation(played):
    config = EnvConfig.of("random", SIZE)
    table = evaluate(["frontier-cost", "random"], config, seeds=SEEDS, traces=True)
    lines = {line["policy"]: line for line in read_results(played, 7)}
    for policy, line in ((name, lines[name]) for name in ("frontier-cost", "random")):
        curves = [result.trace.discovered for result in table.results if result.policy == policy]
        for per_cent in PER_CENT:
            first = [
                next((move for move, k in enumerate(curve) if k / 81 >= per_cent / 100), None)
                for curve in curves
            ]
            assert line["reached"][str(per_cent)] == first
        assert (line["stride"], len(line["mean"])) == (1, max(map(len, curves)))
        at_5 = [curve[min(5, len(curve) - 1)] / 81 for curve in curves]
        assert line["mean"][5] == pytest.approx(np.mean(at_5), abs=1e-5)
        assert line["sd"][5] == pytest.approx(np.std(at_5, ddof=1), abs=1e-5)
        row = next(row for row in table.rows if row.policy == policy)
        assert steps_of(line).mean() == pytest.approx(row.steps_mean)
    assert None in lines["random"]["reached"]["99"]
    assert (steps_of(lines[INFORMED]) <= steps_of(lines["frontier-cost"])).all()


def test_a_terrain_for_which_the_search_finds_no_walk_is_in_no_comparison():
    size = {"rows": 9, "cols": 9}
    policy = {"policy": "a", **size, "reached": {"90": [8, 8, 8], "99": [10, 20, 30]}}
    search = {"policy": INFORMED, **size, "reached": {"90": [5, None, 5], "99": [8, None, 16]}}
    assert np.isnan(steps_of(search)).tolist() == [False, True, False]
    assert compare(policy, search).mean == 40 / 24
    failing = {**policy, "reached": search["reached"]}
    assert steps_of(failing).tolist() == [8, 81, 16], "a policy that fails counts the limit"


def test_what_another_policy_played_under_the_name_is_played_again(tmp_path):
    rules = ("frontier-cost", "frontier-utility")
    job, other = (Visits(rule, "1-1-1", SIZE, 3, label="mine") for rule in rules)
    job.run(tmp_path, nothing)
    (before,) = read_lines(tmp_path / job.name / "result.jsonl")
    assert job.is_done(tmp_path)
    assert not Visits("ppo", "1-1-1", SIZE, 3, label="mine").is_done(tmp_path)
    other.run(tmp_path, nothing)
    assert read_lines(tmp_path / job.name / "result.jsonl")[0]["courses"] != before["courses"]


def test_jobs_are_of_policies_that_can_play_them():
    assert not can_play("ppo-paper", EnvConfig.of("random", 42))
    assert not can_play(INFORMED, EnvConfig.of("random", 84))
    names = {job.name for job in figure7.jobs(["frontier-cost", "ppo-paper", INFORMED])}
    played = ("frontier-cost-2-2-1-84", "ppo-paper-2-2-1-21", "informed-random-42")
    assert names >= {f"figure7-{name}" for name in played}
    assert not names & {"figure7-ppo-paper-2-2-1-42", "figure7-informed-random-84"}
    with pytest.raises(ValueError, match="cannot play 42x42"):
        figure6.jobs(["ppo-paper"], size=42)
    with pytest.raises(ValueError, match="a name of its own"):
        figure6.jobs(["frontier-cost", "frontier-cost"])
    assert len(figure6.jobs(["frontier-cost", "frontier-utility"])) == 2 * 12 + 4


def test_a_policy_of_each_level_goes_by_one_name(tmp_path):
    for level in ("1-1-1", "2-1-1"):
        shutil.copy(find_file("ppo-paper"), tmp_path / f"works-{level}-s0.onnx")
    first, second = figure6.jobs([str(tmp_path / "works-{level}-s0.onnx")], ["1-1-1", "2-1-1"])[:2]
    assert (first.name, second.called) == ("figure6-works-s0-1-1-1-21", "works-s0")
    assert first.policy.endswith("works-1-1-1-s0.onnx")


def test_gathered_results_are_those_of_the_jobs_and_there_must_be_some(played, tmp_path):
    for figure in (6, 7):
        paths = gather(played, figure, tmp_path / "gathered")
        assert {path.name for path in paths} >= {f"figure{figure}-frontier-cost.jsonl"}
        first, again = (read_results(folder, figure) for folder in (played, tmp_path / "gathered"))
        assert sorted(map(json.dumps, first)) == sorted(map(json.dumps, again))
    gather(tmp_path / "gathered", 6, tmp_path / "mixed")
    Visits("frontier-cost", "1-1-1", SIZE, 2).run(tmp_path / "mixed", nothing)
    lines = read_results(tmp_path / "mixed", 6)
    episodes = {(line["policy"], line["level"]): line["episodes"] for line in lines}
    of_rule = [episodes["frontier-cost", level] for level in ("1-1-1", "2-2-1")]
    assert (len(episodes), of_rule) == (4, [2, EPISODES])
    with pytest.raises(FileNotFoundError, match=r"python -m research\.paper --figure 6"):
        figure6.draw(tmp_path / "nowhere", tmp_path)


def test_pictures_and_tables_are_drawn_from_results_alone(played, tmp_path):
    lines = read_results(played, 7)
    names = ("first.svg", "again.svg")
    paths = [save(figure7.steps_figure(lines), tmp_path / name) for name in names]
    first, again = (path.read_bytes() for path in paths)
    assert first == again
    drawn = (*figure6.draw(played, tmp_path), *figure7.draw(played, tmp_path))
    assert {path.name for path in drawn} == {
        "figure6-frontier-cost.svg",
        "figure6-frontier-utility.svg",
        "figure6-quadrants.svg",
        "figure6.md",
        "figure7-coverage.svg",
        "figure7-steps.svg",
        "figure7-shares.svg",
        "figure7.md",
    }
    text = (tmp_path / "figure7.md").read_text()
    assert "| informed | random | 9 | 4 | 100 % |" in text
    assert "| policy | level | size | 50 % | 75 % | 90 % | 95 % | 99 % |" in text


def test_the_shipped_results_are_whole_and_small():
    lines = [line for line in read_results(FOLDER, 6) if "policy" in line]
    for policy in ("ppo-earlier", "ppo-paper-21-s2", *RULES):
        assert [line["level"] for line in lines if line["policy"] == policy] == [*DIFFICULTIES]
    for line in lines:
        makes_u, never_goes_back = course_rates(line)
        assert never_goes_back.count <= makes_u.count <= makes_u.total == line["played"] == 100
    assert {line["null"] for line in read_results(FOLDER, 6) if "null" in line} == set(NULLS)
    rows = {(row.policy, row.level, row.size): row for row in scale_rows(read_results(FOLDER, 7))}
    for place in product(("ppo-earlier", *RULES), figure7.PLACES, (21, 42)):
        assert rows[place].terrains == 100
    assert rows["ppo-earlier", "2-2-1", 42].to_rule.is_known
    assert max(path.stat().st_size for path in FOLDER.glob("figure[67]-*.jsonl")) < 150_000


def test_policies_that_are_drawn_together_have_different_colours():
    others = (
        "a2c-works rainbow-works sac-works ppo-works ppo-works-21-s0 ppo-priced frontier-priced"
    )
    names = [*others.split(), *FIXED_COLOURS]
    assert len(set(colours_of(names).values())) == len(names)
