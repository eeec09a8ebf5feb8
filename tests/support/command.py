"""The commands `humanplay` and `marsexplorer`, run in this process."""

from importlib.util import find_spec

import pytest

from humanplay.cli.main import main


def program_of(word):
    """The program of a command; without MarsExplorer there is only one program."""
    if find_spec("humanplay.tasks.mars") is None:
        return main
    from humanplay.tasks.mars import cli as mars

    return mars.main if word in mars.COMMANDS else main


def run(*args):
    """Run `humanplay ARGS`, or `marsexplorer ARGS`; return the exit code."""
    words = [str(arg) for arg in args]
    with pytest.raises(SystemExit) as left:
        program_of(words[0])(words)
    return left.value.code or 0


def command(capsys, *args):
    """Run a command as `run` does; return its exit code, stdout and stderr.

    Without what was printed before.
    """
    capsys.readouterr()
    return run(*args), *capsys.readouterr()
