"""The measurement of looking ahead goes on where it was stopped."""

from click.testing import CliRunner

from research.lookahead.__main__ import main, read


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
