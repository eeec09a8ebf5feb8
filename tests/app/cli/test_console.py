"""The tables of commands fit a terminal, and bars say how much time remains."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from humanplay.command import console

ROOT = Path(__file__).parents[3]
TABLE = """
from humanplay.command.console import print_table
rows = [("frontier-utility", "100.0%", "100.0 ± 3.0", ""), ("ppo", "99.5%", "71.2 ± 0.8", "a network")]
print_table("Policies", ("policy", "completion", "steps to complete", "what it is"), rows)
"""
BARS = """
from humanplay.command.console import noted_progress, progress
with progress("replaying the episodes") as advance:
    for done in range(3):
        advance(done + 1, 3)
with noted_progress("training", 4, "no move yet") as advance:
    advance(2, "coverage 0.41", "after 2 moves: coverage 0.41")
    advance(4)
print("the end")
"""


def on_a_terminal(code, columns, encoding="utf-8"):
    """What a program prints on a terminal that is so many characters wide."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environ = {name: text for name, text in os.environ.items() if name not in ("COLUMNS", "LINES")}
    environ["PYTHONPATH"], environ["PYTHONIOENCODING"] = str(ROOT / "app"), encoding
    command = [sys.executable, "-c", code]
    process = subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, env=environ, cwd=ROOT
    )
    os.close(theirs)
    printed = b""
    try:
        while part := os.read(ours, 65536):
            printed += part
    except OSError:  # Linux's word for the end of a terminal
        pass
    os.close(ours)
    assert process.wait() == 0, printed
    return printed.decode()


@pytest.mark.parametrize(
    ("columns", "encoding", "lines"),
    [
        (
            80,
            "utf-8",
            [
                "Policies",
                "+------------------+------------+-------------------+------------+",
                "| policy           | completion | steps to complete | what it is |",
                "+------------------+------------+-------------------+------------+",
                "| frontier-utility |     100.0% |       100.0 ± 3.0 |            |",
                "| ppo              |      99.5% |        71.2 ± 0.8 |  a network |",
                "+------------------+------------+-------------------+------------+",
            ],
        ),
        (
            56,
            "ascii",
            [
                "Policies",
                "+------------------+------------+----------+-----------+",
                "| policy           | completion | steps to |   what it |",
                "|                  |            | complete |        is |",
                "+------------------+------------+----------+-----------+",
                "| frontier-utility |     100.0% |  100.0 ± |           |",
                "|                  |            |      3.0 |           |",
                "| ppo              |      99.5% |   71.2 ± | a network |",
                "|                  |            |      0.8 |           |",
                "+------------------+------------+----------+-----------+",
            ],
        ),
        (
            40,
            "utf-8",
            [
                "Policies",
                "frontier-utility",
                "  completion: 100.0%",
                "  steps to complete: 100.0 ± 3.0",
                "  what it is: ",
                "ppo",
                "  completion: 99.5%",
                "  steps to complete: 71.2 ± 0.8",
                "  what it is: a network",
            ],
        ),
    ],
)
def test_a_table_fits_the_terminal_and_breaks_no_word(columns, encoding, lines):
    assert on_a_terminal(TABLE, columns, encoding).splitlines() == lines


@pytest.mark.parametrize("width", [140, 64, 56, 49, 40])
def test_any_cell_is_printed_as_it_is_at_any_width(width, monkeypatch, capsys):
    monkeypatch.setattr(console, "PRINTED_WIDTH", width)
    columns = "policy", "moves in all of its episodes", "is it a network", "what it is"
    rows = [
        ("frontier-cost", "1,579", "False", "a rule with 1,200 lines and no weights"),
        ("ppo", "-1,234.50", "True", "1e5"),
        ("random", "0.10", "", "12,345 draws of one of four moves"),
    ]
    console.print_table("Policies", columns, rows)
    printed = capsys.readouterr().out
    assert all(len(line) <= width for line in printed.splitlines() if line.startswith(("+", "|")))
    assert ("+--" in printed) == (width > 40)
    words = printed.replace("|", " ").split()
    for cell in " ".join(" ".join(row) for row in rows).split():
        assert cell in words


@pytest.mark.parametrize("columns", [80, 40])
def test_a_bar_fits_the_terminal_and_says_how_much_time_remains(columns):
    drawn = re.split(r"[\r\n]+", on_a_terminal(BARS, columns))
    assert max(map(len, drawn)) <= columns
    first = [line for line in drawn if "replaying" in line]
    assert re.fullmatch(r"  0%\|.*\| \? replaying the episodes", first[0])
    noted = [line for line in drawn if "training" in line]
    assert re.fullmatch(r"  0%\|.*\| \? training, no mov.*", noted[1])
    assert re.fullmatch(r"100%\|█+\| 00:00 training, coverage.*", noted[-1])
    # the first bar is wiped away when it ends, the second stays
    assert drawn[drawn.index(first[-1]) + 1].strip() == ""
    assert drawn[-3:] == [noted[-1], "the end", ""]
    assert "after 2 moves" not in "".join(drawn)


def test_a_bar_is_of_letters_alone_where_the_terminal_has_no_others():
    assert "█" not in on_a_terminal(BARS, 80, "ascii")
    assert "100%|##########" in on_a_terminal(BARS, 80, "ascii")


def test_without_a_terminal_lines_stand_in_for_bars():
    process = subprocess.run(
        [sys.executable, "-c", BARS], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert (process.stderr, process.stdout) == ("after 2 moves: coverage 0.41\n", "the end\n")
