"""The golden study: six people and two bots, whose report never changes.

`tests/fixtures/studies` holds the frozen study `golden`, its reports and its export. The database
is played anew for each test, by the same moves: people follow a frontier rule and slip by chance,
one gives up, one crashes, one leaves. After a change of a figure on purpose, `python -m
tests.support.golden_study` writes both again.
"""

import random
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from humanplay.cli.main import main
from humanplay.db.export import export_to
from humanplay.study.folder import Folder
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from tests.support.stored_studies import StudyRecorder

STUDIES = Path(__file__).parents[1] / "fixtures" / "studies"
NAME = "golden"
AGAIN = "after a change on purpose `python -m tests.support.golden_study` writes it again"
SLIPS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4)
REPORTS = {"report.json": (), "report-synthetic.json": ("--synthetic",)}


def play(path):
    """Write the study's database at `path`."""
    recorder = StudyRecorder(path, Folder(STUDIES).study(NAME))
    recorder.random = random.Random(0)  # of ids and tokens
    for number, slips in enumerate((*SLIPS, 0.1, 0.5)):
        kind = "human" if number < len(SLIPS) else "script"
        leaves = number == 5
        person = recorder.join(number, kind, stage="withdrawn" if leaves else "complete")
        recorder.play(person, "tutorial", 0)
        for trial in range(2):
            recorder.play(person, "warm_up", trial, moves_of(slips, number, trial))
        for trial in range(3 if leaves else 6):
            how = {(1, 2): "abandon", (4, 3): "crash"}.get((number, trial))
            recorder.play(person, "ranked", trial, how or moves_of(slips, number, 10 + trial))
    recorder.close()


def moves_of(slips, *seed):
    """A source of an episode's moves: a frontier rule's, and random valid ones."""

    def moves(episode):
        again = Episode.begin(episode.config, terrain=episode.terrain, start=episode.start)
        policy, draws = (
            load("frontier-cost", episode.config.sensor_radius),
            np.random.default_rng(seed),
        )
        policy.reset(0)
        while not again.ended:
            action = policy.act(again.codes)
            if draws.random() < slips:
                action = draws.choice(np.flatnonzero(is_valid(again)))
            again.step(int(action))
        return list(again.actions)

    return moves


def is_valid(episode):
    """Whether each action leads onto a free cell: bool[4]."""
    row, col = episode.position
    rows, cols = episode.terrain.shape
    valid = []
    for down, right in ((-1, 0), (0, 1), (1, 0), (0, -1)):
        at = row + down, col + right
        inside = 0 <= at[0] < rows and 0 <= at[1] < cols
        valid.append(inside and not episode.terrain[at])
    return np.array(valid)


def write_report(database, path, *options):
    """Write the report of a database's study as JSON; return the exit code."""
    files = "--database", str(database), "--json", str(path)
    try:
        main(["report", "--study", NAME, "--no-moves", *files, *options])
    except SystemExit as left:
        return left.code or 0
    return 0


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        play(Path(folder) / "golden.db")
        shutil.copytree(STUDIES, Path(folder) / "golden.db-studies")
        export_to(Path(folder) / "golden.db", STUDIES / "export", "all", lambda done, total: None)
        sys.exit(
            max(
                write_report(Path(folder) / "golden.db", STUDIES / name, *options)
                for name, options in REPORTS.items()
            )
        )
