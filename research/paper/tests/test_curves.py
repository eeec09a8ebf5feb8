"""What is drawn and tabulated is what the logs say, from an export too."""

import csv
import json
from dataclasses import astuple, replace

import numpy as np
import pytest
from scipy import stats

from research.paper.claims.results import read
from research.paper.episodes.play import DIFFICULTIES
from research.paper.figures import figure4, figure5
from research.paper.figures.curves import (
    COLUMNS,
    POINTS,
    add_records,
    band,
    cells_of,
    is_timed_alike,
    read_exported,
    read_records,
    record_of,
    rows_of,
    write_records,
    write_table,
)
from research.paper.tests.logs import trial_of, write_trial


@pytest.fixture
def logs(tmp_path):
    """Three seeds of PPO by the letter, one of SAC, and a trial that is not finished."""
    for seed, end in enumerate((0.5, 0.6, 0.7)):
        write_trial(tmp_path, trial_of(seed=seed), [0.1, end], {"steps": 100.0 + 20 * seed})
    write_trial(tmp_path, trial_of("sac", "works", moves=100), [None, 0.2, 0.9])
    write_trial(tmp_path, trial_of("a2c"), [0.1, 0.2])
    path = tmp_path / trial_of("a2c").name / "log.jsonl"
    path.write_text("".join(line + "\n" for line in path.read_text().splitlines()[:-1]))
    return tmp_path


def of(records, algorithm):
    return [record for record in records if record.trial.algorithm == algorithm]


def test_seeds_are_averaged_where_all_have_points_with_their_t_interval(logs):
    averaged = band(of(read_records(logs), "ppo"), "score", "cpu_s")
    assert (averaged.x[0], averaged.x[-1], averaged.seeds) == (5, 10, 3)
    assert averaged.mean[[0, -1]] == pytest.approx([0.1, 0.6])
    assert averaged.mean[50] == pytest.approx(0.1 + 0.5 * (averaged.x[50] - 5) / 5)
    half = stats.t.ppf(0.975, 2) * 0.1 / np.sqrt(3)
    assert averaged.high[-1] - 0.6 == pytest.approx(half)
    assert 0.6 - averaged.low[-1] == pytest.approx(half)


def test_nothing_is_extrapolated_and_one_seed_has_no_interval(logs, tmp_path):
    records = read_records(logs)
    averaged = band(of(records, "sac"), "score", "moves")
    assert (averaged.x[0], averaged.x[-1], averaged.low) == (
        pytest.approx(66),
        pytest.approx(100),
        None,
    )
    write_trial(tmp_path / "more", trial_of(seed=3), [0.1, 0.3, 0.5], begin=2)
    both = [*of(records, "ppo"), *read_records(tmp_path / "more")]
    assert band(both, "score", "moves").x[0] == pytest.approx(500)
    assert band([], "score", "moves") is None


def test_only_finished_trials_are_read_and_long_curves_are_thinned(logs, tmp_path):
    assert {record.trial.algorithm for record in read_records(logs)} == {"ppo", "sac"}
    write_trial(tmp_path / "long", trial_of(moves=10_000), [number / 1000 for number in range(200)])
    (record,) = read_records(tmp_path / "long")
    assert set(record.curve) == set(COLUMNS)
    assert all(len(column) == POINTS for column in record.curve.values())
    moves, scores = record.curve["moves"], record.curve["score"]
    assert (moves[0], moves[-1], scores[-1]) == (50, 10_000, 0.199)


def test_what_was_exported_is_what_the_logs_give_and_the_claims_read_it(logs, tmp_path):
    records = read_records(logs)
    path = write_records(records, tmp_path / "data" / "figure4.jsonl")
    assert read_exported(path) == records
    kinds = [json.loads(line)["kind"] for line in path.read_text().splitlines()]
    assert (kinds.count("settings"), kinds.count("trial")) == (2, 4)
    trials = read(path.parent).trials(algorithm="ppo", variant="paper")
    assert [trial.curve["score"][-1] for trial in trials] == [0.5, 0.6, 0.7]
    path.write_text('{"kind": "trial"}\n')
    with pytest.raises(ValueError, match="is no file of trials"):
        read_exported(path)


def test_an_export_keeps_trainings_of_other_kinds_and_none_of_an_earlier_run_of_the_same(
    logs, tmp_path
):
    path = write_records(read_records(logs), tmp_path / "data" / "figure4.jsonl")
    write_trial(tmp_path / "more", trial_of(seed=1), [0.1, 0.2])
    write_trial(tmp_path / "more", trial_of(seed=0, variant="works-no-mask"), [0.1, 0.2])
    new = read_records(tmp_path / "more")
    add_records(new, path)
    trials = [exported.trial for exported in read_exported(path)]
    named = [(trial.variant, trial.algorithm, trial.seed) for trial in trials]
    assert named == [("paper", "ppo", 1), ("works", "sac", 0), ("works-no-mask", "ppo", 0)]
    assert all(record in read_exported(path) for record in new)
    whole = path.read_bytes()
    add_records(new, path)
    assert path.read_bytes() == whole


def test_the_table_has_means_over_seeds_with_intervals(logs, tmp_path):
    rows = rows_of(read_records(logs))
    kinds = [(row.algorithm, row.variant, row.seeds) for row in rows]
    assert kinds == [("ppo", "paper", 3), ("sac", "works", 1)]
    half = stats.t.ppf(0.975, 2) * 20 / np.sqrt(3)
    assert astuple(rows[0].steps) == pytest.approx((120, 120 - half, 120 + half))
    assert rows[0].ratio.mean == pytest.approx(1.5)
    assert cells_of(rows[0])[3:8] == ["3", "1 k", "1.2", "10", "0.600 ± 0.248"]
    assert cells_of(rows[1])[7:] == ["0.900", "90 %", "90 %", "100", "1.25"]
    written = write_table(rows, tmp_path / "table")
    assert [path.name for path in written] == ["table.csv", "table.jsonl"]
    first = json.loads(written[1].read_text().splitlines()[0])
    numbers = [first[name] for name in ("score", "score_low", "cpu_minutes")]
    assert numbers == [0.6, pytest.approx(0.3516, abs=1e-4), 1.167]


def test_figure_4_has_a_column_for_each_variant_and_the_curves_of_the_logs(logs):
    human = figure4.HumanLevel("dunes", 10, 0.94, 0.93, 0.95)
    write_trial(logs / "longest", trial_of("a2c", "works", moves=5000), [0.1, 0.2])
    records = [*read_records(logs), *read_records(logs / "longest")]
    for against, last in (("moves", 1000), ("cpu_s", 10 / 60)):
        figure = figure4.curves_figure(records, against, human)
        (letter,) = (
            axes for axes in figure.axes if axes.get_title(loc="left") == "the letter of the paper"
        )
        x, y = letter.get_lines()[0].get_data()
        assert (x[-1], y[-1]) == (pytest.approx(last), pytest.approx(0.6))
        lines = [line.get_xdata() for axes in figure.axes[:6] for line in axes.get_lines()]
        longest = max(max(x) for x in lines if len(x) > 2)
        assert all(axes.get_xlim()[1] >= longest for axes in figure.axes if axes.get_lines())
        assert any(np.allclose(line.get_ydata(), 0.94) for line in letter.get_lines())


def test_cpu_times_are_compared_where_all_are_of_one_processor_that_was_logged(logs, tmp_path):
    records = read_records(logs)
    named = [
        replace(record, versions={"hardware": "x86_64, one of them, one thread"})
        for record in records
    ]
    other = replace(named[0], versions={"hardware": "x86_64, another, one thread"})
    untimed = replace(named[0], curve=named[0].curve | {"cpu_s": [None]})
    assert is_timed_alike(named)
    for differing in (records, [other, *named[1:]], [untimed, *named[1:]]):
        assert not is_timed_alike(differing)
    for several, is_said in ((named, False), ([other, *named[1:]], True), (records, True)):
        paths = {path.name: path for path in figure4.draw(several, tmp_path)}
        assert ("not known to be the same" in paths["figure4-cpu.svg"].read_text()) == is_said
        assert "not known to be the same" not in paths["figure4-moves.svg"].read_text()


def test_a_training_whose_cpu_time_is_not_known_has_none_in_the_table_and_is_not_drawn_against_it(
    logs, tmp_path
):
    records = of(read_records(logs), "ppo")
    assert "figure4-cpu.svg" in {path.name for path in figure4.draw(records, tmp_path)}
    nothing = [None] * len(records[0].curve["moves"])
    untimed = [
        replace(
            record, curve=record.curve | {"cpu_s": nothing}, result=record.result | {"cpu_s": None}
        )
        for record in records
    ]
    assert "figure4-cpu.svg" not in {path.name for path in figure4.draw(untimed, tmp_path)}
    (row,) = rows_of(untimed)
    assert cells_of(row)[4:6] == ["1 k", ""]
    csv_path, lines_path = write_table([row], tmp_path / "table")
    assert json.loads(lines_path.read_text())["cpu_minutes"] is None
    with csv_path.open() as file:
        (line,) = csv.DictReader(file)
    assert (line["moves"], line["cpu_minutes"]) == ("1000.0", "")


def test_figure_5_has_a_line_for_each_level(tmp_path):
    for number, level in enumerate(DIFFICULTIES):
        write_trial(tmp_path, trial_of(level=level), [0.1, 0.2 + number / 100])
    figure = figure5.levels_figure(read_records(tmp_path))
    ends = [line.get_ydata()[-1] for axes in figure.axes[:3] for line in axes.get_lines()]
    assert sorted(ends) == pytest.approx([0.2 + number / 100 for number in range(12)])
    steps = {"mean": 51.0, "low": 50.0, "high": 52.0}
    reference = [{"policy": "informed", "level": "2-1-1", "steps_to_99": steps}]
    panel = figure5.difficulty_figure(read_records(tmp_path), reference).axes[-1]
    bars = [line.get_xdata().tolist() for line in panel.get_lines() if 51 in line.get_ydata()]
    assert bars == [[1.66, 2.34]]


def test_a_curve_begins_when_enough_episodes_have_ended():
    head = {"kind": "trial", "trial": vars(trial_of()), "settings": {}, "versions": {}}
    head |= {"hardware": ""}
    line = {"kind": "curve", "cpu_s": 1.0}
    lines = [{**line, "moves": moves, "episodes": float(moves)} for moves in (99, 100, 300)]
    assert record_of([head, *lines, {"kind": "result"}]).curve["moves"] == [100, 300]
    assert record_of([head, lines[0], {"kind": "result"}]).curve["moves"] == [99]
