"""The command `marsexplorer`, run in this process."""

import pytest

from humanplay.cli.main import main


def run(*args):
    """Run `marsexplorer ARGS`; return its exit code."""
    with pytest.raises(SystemExit) as left:
        main([str(arg) for arg in args])
    return left.value.code or 0


def command(capsys, *args):
    """Run `marsexplorer ARGS`; return its exit code, stdout and stderr, without what was said before."""
    capsys.readouterr()
    return run(*args), *capsys.readouterr()
