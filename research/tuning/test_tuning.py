"""Tuning plays the policy's moves, goes on where it stopped, and compares truly."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.priced import TUNED, FrontierPriced

pytest.importorskip("cmaes", reason="of the environment of research: `make paper`")
from research.tuning.__main__ import tune
from research.tuning.priced_episodes import PricedEpisodes
from research.tuning.search import (
    LOWEST,
    SPREAD,
    TuneConfig,
    TuneRun,
    ablations,
    compare_rules,
    make_episodes,
    read_rule,
    to_rule,
    to_vector,
)

FEW = ("--level", "random", "--size", "7x11", "--terrains", "2")
SMALL = EnvConfig.of("random", (7, 11))


@pytest.fixture
def pool():
    with ThreadPoolExecutor(2) as threads:
        yield threads


def test_stacked_episodes_are_the_policy_s_own_whatever_was_played_before():
    config, seeds = EnvConfig("2-2-1", 15, 22, sensor_radius=4), range(70, 76)
    episodes, rules = (
        PricedEpisodes(config, seeds),
        [TUNED, ablations(TUNED)["without pockets"], TUNED],
    )
    for rule in rules:
        alone = [play_episode(FrontierPriced(4, rule), config, seed).steps for seed in seeds]
        assert episodes.play(rule).tolist() == alone
    assert len(set(alone)) > 1


def test_the_same_configuration_gives_the_same_rule_and_each_point_is_announced(pool):
    config, done = TuneConfig((SMALL, EnvConfig.of("1-1-1", (9, 7))), terrains=1), []
    first, again = TuneRun(config), TuneRun(config)
    for _ in range(2):
        first.run_generation(pool, done.append)
        again.run_generation(pool, lambda done: None)
    assert done == 2 * list(range(1, first.points + 1))
    assert first.rule == again.rule != TUNED


def test_only_the_chosen_end_moves(pool):
    run = TuneRun(TuneConfig((SMALL,), 1, ("large",)))
    run.run_generation(pool, lambda done: None)
    assert (run.rule.small, run.rule.middle) == (TUNED.small, TUNED.middle)
    assert run.rule.large != TUNED.large


def test_a_point_with_fewer_moves_has_a_lower_value(pool):
    """The mean ratio to the first parameters: those themselves have exactly 1."""
    [episodes] = make_episodes([SMALL], 3, 5)
    assert episodes.play(TUNED).shape == (round(3 * 441 / 77),)
    bad = ablations(TUNED)["power of the way 2"]
    ratios = compare_rules(
        TUNED, {"itself": TUNED, "bad": bad}, [episodes], pool, lambda done, of: None
    )
    assert ratios["itself"] == [(1.0, 1.0, 1.0)]
    mean, low, high = ratios["bad"][0]
    assert mean == pytest.approx(episodes.play(bad).mean() / episodes.play(TUNED).mean())
    assert low <= mean <= high


def test_a_rule_is_its_vector_and_its_document():
    for rule in (TUNED.small, TUNED.middle, TUNED.large):
        assert to_rule(to_vector(rule), rule.limit) == rule
    assert to_vector(to_rule(np.full(len(SPREAD), -9.0), 1.0)).tolist() == LOWEST.tolist()
    assert read_rule(json.loads(json.dumps(asdict(TUNED)))) == TUNED
    with pytest.raises(KeyError):
        read_rule({"small": {}})


def test_every_ablation_takes_out_what_it_says():
    rules = ablations(TUNED)
    assert len(set(map(str, rules.values())) | {str(TUNED)}) == len(rules) + 1
    assert rules["without the square of half side 6"].large.prices.weights == (
        TUNED.large.prices.weights[0],
        0.0,
        TUNED.large.prices.weights[2],
    )
    assert rules["every unknown cell counts 1"].small.prices.pocket == 0.0


def run(*args):
    """Return the exit code of the command and everything that it printed."""
    done = CliRunner().invoke(tune, [*map(str, args)], env={"COLUMNS": "140"})
    return done.exit_code, done.output


def test_a_run_writes_its_parameters_and_a_second_one_spares_them(tmp_path):
    folder = tmp_path / "run"
    code, text = run(*FEW, "--generations", 1, "--out", folder)
    assert code == 0, text
    assert "from seed 4000000000 on" in " ".join(text.split())
    assert read_rule(json.loads((folder / "parameters.json").read_text())) != TUNED
    code, text = run(*FEW, "--generations", 1, "--out", folder)
    assert (code, "holds a run already" in text) == (2, True)


@pytest.mark.parametrize("text", [None, "[", "{}", '{"small": {"prices": 1}}'])
def test_a_file_without_parameters_is_refused_in_a_sentence(tmp_path, text):
    path = tmp_path / "other.json"
    if text is not None:
        path.write_text(text)
    code, printed = run(*FEW, "--from", path)
    assert code == 2
    assert "give the parameters.json of a run" in printed


def test_the_ablation_prints_a_row_for_each_term():
    code, text = run(*FEW, "--ablate")
    assert code == 0, text
    assert "without the square of half side 6" in text
    assert "7x11" in text
    assert " ± " in text
