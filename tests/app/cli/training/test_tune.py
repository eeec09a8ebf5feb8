"""`marsexplorer tune` from the command line: a run, what it leaves, going on with it, and the ablation."""

import json

import pytest

from app.cli.main import main
from marsexplorer.policies.priced import TUNED
from marsexplorer.training.tuning import read_rule

FEW = ("--level", "random", "--size", "7x11", "--terrains", "2")


@pytest.fixture
def run(capsys):
    """`run("--size", 21, ...)` -> (exit code, everything that was printed)."""

    def call(*args):
        with pytest.raises(SystemExit) as left:
            main(["tune", *map(str, args)])
        printed = capsys.readouterr()
        return left.value.code or 0, printed.out + printed.err

    return call


def test_a_run_is_gone_on_with_and_ends_where_it_would_have_ended(run, tmp_path):
    at_once, in_parts = tmp_path / "at once", tmp_path / "in parts"
    code, text = run(*FEW, "--generations", 2, "--out", at_once)
    assert code == 0, text
    assert "from seed 4000000000 on" in " ".join(text.split())
    assert run(*FEW, "--generations", 1, "--out", in_parts)[0] == 0
    after_one = json.loads((in_parts / "parameters.json").read_text())
    assert run(*FEW, "--generations", 2, "--out", in_parts, "--resume")[0] == 0
    for name in ("log.jsonl", "parameters.json"):
        assert (in_parts / name).read_text() == (at_once / name).read_text()
    assert json.loads((at_once / "parameters.json").read_text()) != after_one
    assert read_rule(after_one) != TUNED


def test_what_cannot_be_gone_on_with_is_refused_in_a_sentence(run, tmp_path):
    folder = tmp_path / "run"
    assert "begin one without --resume" in run(*FEW, "--out", folder, "--resume")[1]
    assert run(*FEW, "--generations", 1, "--out", folder)[0] == 0
    assert "holds a run already" in run(*FEW, "--generations", 1, "--out", folder)[1]
    code, text = run(*FEW, "--generations", 2, "--out", folder, "--resume", "--seed", 3)
    assert code == 2
    assert "begun with other options" in text


@pytest.mark.parametrize("text", [None, "[", "{}", '{"small": {"prices": 1}}'])
def test_a_file_without_parameters_is_refused_in_a_sentence(run, tmp_path, text):
    path = tmp_path / "other.json"
    if text is not None:
        path.write_text(text)
    code, found = run(*FEW, "--from", path)
    assert code == 2
    assert "give the parameters.json of a run" in found


def test_the_ablation_prints_a_row_for_each_term(run, tmp_path):
    code, text = run(*FEW, "--ablate")
    assert code == 0, text
    assert "without the square of half side 6" in text
    assert "7x11" in text
    assert " ± " in text
