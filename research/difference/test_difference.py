"""Each verdict of the design comes out both ways; a stopped training goes on."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.compat import make
from marsexplorer.compat.env import KoutrasCodeVector
from marsexplorer.evaluation import RULES
from marsexplorer.training.envs import EVALUATION_SEEDS
from research.difference import held_out, picture
from research.difference.__main__ import main
from research.difference.answers import (
    RULE_RESULTS,
    Record,
    effect_of,
    effect_of_passes,
    in_short,
    read_records,
    reasons,
    sweeps,
    table,
    verdict,
)
from research.difference.code_envs import CodeEnvs
from research.difference.design import Training, combinations, full_passes, random_level
from research.difference.picture import CURVE, PANELS, VIDEOS, draw, draw_curve
from research.paper.jobs import read_lines
from research.paper.tables import Estimate


def record(training, coverage, finished=True):
    line = {
        "kind": "curve",
        "moves": training.moves,
        "coverage": coverage,
        "out_of_bounds": 0.9,
        "collided": 0.1,
    }
    result = {
        "kind": "result",
        "coverage": coverage,
        "covers_most": 0.5,
        "explored": 0.0,
        "clean_u": 0.25,
    }
    return Record(training, ("a machine",), (line,) * 5, result if finished else None)


def records(coverage_of):
    return {training: record(training, coverage_of(training)) for training in combinations()}


def test_the_design_has_the_trainings_that_it_says():
    assert len(set(combinations())) == 24
    assert [training.settings.update_epochs for training in full_passes()] == [30] * 3
    assert {training.moves for training in random_level()} == {9_000_000}
    settings = {
        training.estimates: (training.settings.gamma, training.settings.gae_lambda)
        for training in combinations()
    }
    assert settings == {"text": (0.95, 0.95), "code": (0.9, 1.0)}


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((0.2, 0.11, 0.3), "makes the difference"),
        ((-0.2, -0.3, -0.11), "makes the difference"),
        ((0.0, -0.05, 0.05), "makes no difference"),
        ((0.1, -0.05, 0.25), "undecided"),
        ((0.2, 0.05, 0.35), "undecided whether enough to count"),
        ((-0.2, -0.35, -0.05), "undecided whether enough to count"),
    ],
)
def test_an_effect_makes_a_difference_or_none_or_is_undecided(interval, words):
    assert verdict(Estimate(*interval)) == words


def test_coverage_sweeps_with_certainty_or_shows_nothing():
    assert sweeps([0.80, 0.82, 0.81])
    assert not sweeps([0.60, 0.82, 0.81])
    assert not sweeps([0.9])


def test_the_effect_of_a_factor_is_found_where_it_was_put():
    stored = records(
        lambda training: (
            0.5
            + 0.2 * (training.world == "code")
            - 0.1 * (training.leaving == "costs")
            + 0.01 * training.seed
        )
    )
    assert effect_of("world", stored).mean == pytest.approx(0.2)
    assert effect_of("leaving", stored).mean == pytest.approx(0.1)
    assert effect_of("estimates", stored).mean == pytest.approx(0)
    assert effect_of("world", stored).low == pytest.approx(0.2)


def test_what_is_not_finished_decides_nothing():
    stored = records(lambda _: 0.5)
    training = combinations()[3]
    stored[training] = replace(stored[training], result=None)
    assert effect_of("world", stored) is None
    assert effect_of_passes(stored) is None
    stored = records(lambda _: 0.5) | {full: record(full, 0.7) for full in full_passes()}
    assert effect_of_passes(stored).mean == pytest.approx(0.2)
    assert "not all finished" not in reasons(stored)
    assert "not all finished" in reasons(records(lambda _: 0.5))


def test_the_words_follow_from_the_trainings():
    def words(*u_shares, begun=()):
        stored = records(lambda training: 0.9 if training.world == "code" else 0.4)
        for training, u_share in zip(full_passes(), u_shares, strict=True):
            shares = {
                "coverage": 0.96,
                "clean_u": u_share,
                "explored": 0.2,
                "out_of_bounds": 0.1,
            }
            stored[training] = replace(record(training, 0.95), result=shares)
        stored |= {training: record(training, 0.7, finished=False) for training in begun}
        return " ".join(in_short(stored).split())

    sweeping = words(0.9, 0.6, 0.8)
    assert "On terrains kept apart" in sweeping
    assert "makes 960, covers 40 % of the text's world and completes 0 %" in sweeping
    assert "960 gradient steps an update it covers 96 % of the code's" in sweeping, (
        "not the training's 0.95"
    )
    assert "of the code's it covers 90 %" in sweeping
    assert "for 3 of these 3 seeds: 90.0 and 60.0 and 80.0 %, where 20.0 and" in sweeping
    assert "For the others" not in sweeping
    assert words(0.1, 0.0, 0.2).endswith("as in the videos, for 0 of these 3 seeds.")
    assert words(0.1, 0.9, 0.2).endswith(
        "for 1 of these 3 seeds: 90.0 %, where 20.0 % complete the terrain and 10.0 % leave the "
        "grid. For the others it is 10.0 and 20.0 %, where 20.0 and 20.0 % complete the terrain "
        "and 10.0 and 10.0 % leave the grid."
    )
    assert "stopped after" not in sweeping
    in_the_text = Training("text", "text", "free", 0, "full", moves=280_000)
    there = words(0.9, 0.6, 0.8, begun=[in_the_text])
    assert (
        "With 960 in the text's, stopped after 280,000 of 800,000 moves, it covered 70 % in"
        in there
    )
    assert in_short(records(lambda _: 0.5)) == ""


def test_a_table_has_its_head_without_trainings_and_one_line_of_a_single_one():
    assert table({}).splitlines()[0].startswith("| level | passes | world |")
    ((training, only), *_) = records(lambda _: 0.5).items()
    assert table({training: only}).startswith("In all rows: level videos, passes light, world ")
    assert len(table({training: only}).splitlines()) == 1


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_played_again_in_the_codes_world_has_the_stored_results(rule):
    (stored,) = (line for line in read_lines(RULE_RESULTS) if line["policy"] == rule)
    assert held_out.play_rule(rule) == stored


@pytest.mark.parametrize("world", ["text", "code"])
def test_a_training_that_was_stopped_ends_as_one_that_was_not(world, tmp_path):
    training = Training(world, "code", "free", 1, moves=12_000)
    calls = []

    def stop(share):
        calls.append(share)
        if len(calls) == 1:
            raise KeyboardInterrupt

    training.run(tmp_path / "whole", lambda share: None)
    with pytest.raises(KeyboardInterrupt):
        training.run(tmp_path / "stopped", stop)
    assert not training.is_done(tmp_path / "stopped")
    training.run(tmp_path / "stopped", lambda share: None)
    logs = [tmp_path / name / training.name / "log.jsonl" for name in ("whole", "stopped")]
    assert logs[0].read_text() == logs[1].read_text()
    assert training.is_done(tmp_path / "stopped")
    (trained,) = read_records(logs[:1]).values()
    assert len(trained.result["actions"]) == 20
    assert trained.result["coverage"] > 0


def test_training_in_the_codes_world_refuses_the_terrains_kept_apart():
    envs = CodeEnvs(KoutrasCodeVector(2, "videos", observation="uint8"), 0)
    state = envs.state_dict()
    state["worlds"]["seeds"][1] = EVALUATION_SEEDS.start
    envs.load_state_dict(state)
    with pytest.raises(ValueError, match=f"training met seed {EVALUATION_SEEDS.start}"):
        envs.step(np.array([0, 2]))  # the first one leaves the grid


def test_a_training_that_fails_fails_the_command(tmp_path):
    for training in random_level():
        checkpoint = tmp_path / training.name / "checkpoint.pt"
        checkpoint.parent.mkdir()
        checkpoint.write_bytes(b"no checkpoint")
    outcome = CliRunner().invoke(main, ["--out", str(tmp_path), "--part", "random"])
    assert outcome.exit_code == 1
    assert outcome.output.count(" failed: ") == 3


def test_the_paths_of_the_videos_are_played_in_the_codes_world():
    actions = {(1, 0): 0, (-1, 0): 1, (0, 1): 2, (0, -1): 3}
    for video in read_lines(VIDEOS):
        terrain = np.zeros((21, 21), bool)
        terrain[tuple(np.transpose(video["blocked"]))] = True
        env = make(preset="videos")
        env.reset(options={"terrain": terrain})
        for (x, y), (next_x, next_y) in pairwise(video["path"]):
            _, _, done, _, info = env.step(actions[next_x - x, next_y - y])
            assert not done
        assert 0.947 < info["coverage"] < 0.955
        assert env.step(3)[2:] == (True, False, {**info, "outcome": "out_of_bounds"})
        assert terrain.sum() == 9


def test_the_curve_of_cleanrls_loop_is_drawn_from_what_is_stored(tmp_path, monkeypatch):
    drawn = draw_curve(tmp_path).read_text()
    shorter = tmp_path / "curve.csv"
    shorter.write_text("".join(CURVE.read_text().splitlines(keepends=True)[:9]))
    monkeypatch.setattr(picture, "CURVE", shorter)
    assert draw_curve(tmp_path).read_text() != drawn


def test_the_picture_shows_four_panels(tmp_path):
    text = draw(tmp_path).read_text()
    assert all(title in text for title, _ in PANELS)
