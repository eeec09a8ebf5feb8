"""A report made from an imported release is the report of the study it was released from, in every figure."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from app.cli.main import main
from app.release.bundle import import_release
from app.report import build
from app.statistics.exclusion_sets import members, people_of
from tests.support import golden
from tests.support.made_studies import played, run, study

PARTS = (
    "figures",
    "metrics",
    "players",
    "comparisons",
    "outcomes",
    "labels",
    "primary",
    "pictures",
    "finished",
    "started",
)
"""Of a group; who withdrew before playing is in no release, so `joined` and `left` may differ."""


def report_of(database, studies, path, *options):
    with pytest.raises(SystemExit) as left:
        main(
            [
                "report",
                "--study",
                "dunes",
                "--database",
                str(database),
                "--studies",
                str(studies),
                "--json",
                str(path),
                *options,
            ]
        )
    assert not left.value.code
    return json.loads(path.read_text())


@pytest.mark.parametrize("options", [(), pytest.param(("--synthetic",), marks=pytest.mark.long)])
def test_every_figure_of_an_imported_release_is_the_studys(tmp_path, options):
    folder = golden.studies(tmp_path)
    shutil.unpack_archive(folder / "release" / "dunes-1.zip", folder)
    import_release(folder / "dunes-1", tmp_path / "other.db")
    own = report_of(folder / "studies-play.db", folder, tmp_path / "own.json", *options)
    other = report_of(
        tmp_path / "other.db", tmp_path / "no-studies", tmp_path / "other.json", *options
    )
    for one, two in zip(own["groups"], other["groups"], strict=True):
        assert {part: one[part] for part in PARTS} == {part: two[part] for part in PARTS}
    assert own["sentence"] == other["sentence"]


def renamed(people, trials, names):
    """Return the same people and trials under other ids."""
    return [replace(each, id=names[each.id]) for each in people], [
        replace(each, participant=names[each.participant]) for each in trials
    ]


def test_pseudonyms_move_no_end_of_an_interval():
    scores = np.random.default_rng(5).normal(0.7, 0.1, (8, 6)).clip(0, 1)
    people, trials = played(scores)
    runs = [run("ppo", scores.mean(0) + 0.05), run("random", [0.2] * 6)]
    own = build(study(people, trials), runs)
    for seed in range(3):
        drawn = np.random.default_rng(seed).permutation(8)
        names = {each.id: f"{number:032x}" for each, number in zip(people, drawn, strict=True)}
        other = build(study(*renamed(people, trials, names)), runs)
        assert other.groups == own.groups


def test_the_order_of_players_is_that_of_what_they_played():
    people, trials = played([[0.9, 0.1], [0.2, 0.8], [0.9, 0.0]], steps=[[20, 20]] * 3)
    cohort = people_of(study(people, trials, ranked=2))
    assert members(cohort, {}) == [people[1].id, people[2].id, people[0].id]
