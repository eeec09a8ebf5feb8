"""Without POSIX, as on Windows: what works, and the error for what does not."""

import os
import subprocess
import sys

import pytest

WITHOUT = """
import os, socket, sys
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
del os.fork, socket.AF_UNIX
from importlib import import_module
module, *sys.argv[1:] = sys.argv[1:]
import_module(module).main()
"""


def without_posix(tmp_path, program, *words):
    module = {"humanplay": "humanplay.cli.main", "marsexplorer": "humanplay.tasks.mars.cli"}[
        program
    ]
    command = [sys.executable, "-c", WITHOUT, module, *map(str, words)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "words",
    [
        "serve",
        "play",
        "doctor FrozenLake-v1",
        "export --out x",
        "study list",
        "verify",
        "backup x.db",
        "merge a.db b.db --out c.db",
    ],
)
def test_a_command_that_needs_posix_says_so_in_one_sentence(tmp_path, words):
    code, _, err = without_posix(tmp_path, "humanplay", *words.split())
    assert code == 2
    assert err.startswith(f"humanplay: humanplay {words.split()[0]} needs Linux, macOS or WSL")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "words", ["policies list", "evaluate --policy random --episodes 21 --size 6"]
)
def test_policies_are_listed_and_evaluated_without_it(tmp_path, words):
    code, out, err = without_posix(tmp_path, "marsexplorer", *words.split())
    assert (code, "random" in out) == (0, True), err
