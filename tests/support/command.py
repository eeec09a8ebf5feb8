"""The commands `humanplay` and `marsexplorer`, run in this process."""

import pytest

from humanplay.cli.main import main
from humanplay.tasks.mars import cli as mars


def run(*args):
    """Run `humanplay ARGS`, or `marsexplorer ARGS` for a command of that; return its exit code."""
    words = [str(arg) for arg in args]
    with pytest.raises(SystemExit) as left:
        (mars.main if words[0] in mars.COMMANDS else main)(words)
    return left.value.code or 0


def command(capsys, *args):
    """Run a command as `run` does; return its exit code, stdout and stderr, without what was said before."""
    capsys.readouterr()
    return run(*args), *capsys.readouterr()
