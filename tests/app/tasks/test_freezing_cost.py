"""What freezing a study costs beside the environment's own steps and pictures."""

import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.declared import DECLARATIONS_FILE

pytestmark = pytest.mark.bench
LAKE = Path(__file__).parents[2] / "support" / "timed_lake.py"
SMALL = ("--players", "3", "--ranked", "4", "--warm-up", "1")
"""So small that no power is simulated."""
MOST_S = 20.0
"""Seconds of processor that freezing may take beyond the environment's own."""


def taken_s():
    """Seconds of processor of all processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def test_freezing_costs_little_beside_the_environment_itself(tmp_path):
    shutil.copy(LAKE, tmp_path / "lake.py")

    def study(*arguments):
        command = [sys.executable, "-P", "-m", "humanplay.cli", "study", *arguments]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)

    declared = ("--declarations", DECLARATIONS_FILE)
    study("new", "cold", "--env", "lake:TimedLake", *declared, "--database", "lake.db", *SMALL)
    began_s = taken_s()
    study("freeze", "cold", "--underpowered", "--database", "lake.db")
    whole_s = taken_s() - began_s
    seconds = [float(file.read_text()) for file in tmp_path.glob("seconds-*")]
    own_s, count = sum(seconds), len(seconds)
    print(
        f"\nfreezing {whole_s:.1f} s of processor, {own_s:.1f} the environment's, {count} processes"
    )
    assert whole_s - own_s <= MOST_S
