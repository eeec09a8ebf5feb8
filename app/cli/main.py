"""The command `marsexplorer`: a group whose commands live in app/cli, one module each.

Whatever goes wrong ends in one sentence on stderr: exit code 2 for a command that cannot be carried out as given, 1 for a
failure on the way, 130 for Ctrl-C. A command's module is imported when it is asked for, so that `--help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

import click

COMMANDS = {
    "serve": "Play and watch in a browser; record every move.",
    "export": "Write what was played as CSV or JSON Lines.",
    "evaluate": "Score policies on the same terrains.",
    "train": "Train a policy on this machine.",
    "refine": "Let a trained policy learn from moves it did not make.",
    "sweep": "Train on many levels and seeds with Ray.",
    "bench": "Measure how fast the environment is here.",
    "study": "Plan, freeze and close a study of how well people play.",
    "simulate": "Let synthetic players take part in a study.",
    "report": "A study's figures with their intervals, as a page and as JSON.",
    "verify": "Simulate every episode again and compare.",
    "release": "Write a study as a citable, signed bundle.",
    "import": "Bring a released bundle into a database.",
    "merge": "Join the databases of several servers.",
    "forget": "Erase a participant.",
}
"""Name -> what `marsexplorer --help` says of it. The command NAME is `app.cli.NAME.NAME`, a dash an underscore."""

_MODULES = {"import": "import_release"}
"""Where a command's name is a word of Python's."""


class Commands(click.Group):
    """A group that knows its commands by name and imports one only to run or explain it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of COMMANDS."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, its module imported now; None for an unknown name."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        name = _MODULES.get(cmd_name, cmd_name.replace("-", "_"))
        command = getattr(import_module(f"app.cli.{name}"), name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="marsexplorer-playground", prog_name="marsexplorer")
def cli() -> None:
    """Drive the MarsExplorer rover in a browser, beside a policy; keep every episode; compare.

    \b
    Begin with:
      marsexplorer serve                                    play at http://127.0.0.1:8000
      marsexplorer export --format csv --out results        what was played, as tables
      marsexplorer evaluate --policy frontier-cost          a policy's score, with its interval
      marsexplorer train --minutes 15 --out runs/mine       a policy of your own
    Each command explains itself: marsexplorer serve --help
    """


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave with its exit code."""
    try:
        code = cli.main(args, prog_name="marsexplorer", standalone_mode=False)
    except click.UsageError as error:
        hint = f" (see {error.ctx.command_path} --help)" if error.ctx else ""
        click.echo(f"marsexplorer: {error.format_message()}{hint}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        click.echo(f"marsexplorer: {error.format_message()}", err=True)
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)
