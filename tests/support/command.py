"""The command `marsexplorer`, run in this process."""

import pytest

from app.cli.main import main


def command(capsys, *args):
    """Run `marsexplorer ARGS`; return its exit code, stdout and stderr, without what was said before."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as left:
        main([str(arg) for arg in args])
    said = capsys.readouterr()
    return left.value.code or 0, said.out, said.err
