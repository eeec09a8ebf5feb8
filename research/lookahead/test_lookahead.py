"""The measurement of looking ahead goes on where it was stopped, and a decision is worth at most what the map would give."""

from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.terrain import generate
from research.lookahead.__main__ import main, read
from research.lookahead.stages import Watched


def test_a_second_run_adds_what_is_missing_and_changes_nothing(tmp_path):
    words = ["--size", "21", "--seed", "5", "--out", str(tmp_path)]
    for terrains in ("2", "2", "3"):
        done = CliRunner().invoke(main, [*words, "--terrains", terrains])
        assert done.exit_code == 0, done.output
    lines = (tmp_path / "21.csv").read_text().splitlines()
    assert lines[0] == "side,seed,ppo,lookahead,decisions,seconds"
    rows = read(tmp_path / "21.csv")
    assert [row[1] for row in rows] == [5, 6, 7]
    assert all(row[2] > 30 and row[3] > 30 and row[4] > 5 for row in rows)


def test_what_a_decision_finds_is_at_most_what_knowing_the_map_gives():
    config, watched = EnvConfig.of("random", 15), Watched()
    watched.watch(generate(config, 5), 5)
    play_episode(watched, config, 5)
    shares, found, known, _ = zip(*watched.decisions, strict=True)
    assert min(shares) < 0.6 < max(shares)
    assert all(some <= most for some, most in zip(found, known, strict=True))
    assert min(known) >= 0 < max(known)
