"""The command `marsexplorer`: a group of commands, in modules of app/humanplay/cli and its folders.

Every failure ends with one sentence on stderr: exit code 2 for a command that cannot be carried out as given or needs an extra
that is not installed, 1 for a failure on the way, 130 for Ctrl-C. A command's module is imported when the command is called, so
that `--help` answers at once.
"""

from __future__ import annotations

import difflib
import re
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from humanplay.cli.commands import COMMANDS, missing_extra

try:
    import click
except ModuleNotFoundError as error:  # the environment can be installed without the command
    if (sentence := missing_extra(error, sys.argv[1:])) is None:
        raise
    print(f"marsexplorer: {sentence}", file=sys.stderr)
    sys.exit(2)


class Commands(click.Group):
    """A group that knows its commands by name and imports the module of one only to run it or to show its help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of COMMANDS."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command's module and return the command; None for an unknown name."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f".{COMMANDS[cmd_name][0]}", "humanplay.cli")
        command = getattr(module, "import_release" if cmd_name == "import" else cmd_name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, _, line) in COMMANDS.items()])


SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 110, "show_default": True}


@click.group(cls=Commands, context_settings=SETTINGS)
@click.version_option(package_name="humanplay", prog_name="marsexplorer")
def cli() -> None:
    """Drive the MarsExplorer rover in a browser, watch policies, record every episode, and compare.

    \b
    Begin with:
      marsexplorer serve                                    play at http://127.0.0.1:8000
      marsexplorer export --out results                     write the recorded episodes as tables
      marsexplorer evaluate --policy frontier-cost          score a policy, with an interval
      marsexplorer train --minutes 15 --out runs/mine       train a policy of your own
    Every command has its own help: marsexplorer serve --help
    """


KEPT_BY_CTRL_C = frozenset({"train", "refine"})
"""Commands that keep what they have done when Ctrl-C ends them; SIGTERM ends them the same way."""


def _guess(error: click.UsageError) -> str:
    """Return a question after the command that was meant, if one is near."""
    found = re.match(r"No such command '(.+)'", error.format_message())
    if found is None or error.ctx is None or not isinstance(error.ctx.command, click.Group):
        return ""
    near = difflib.get_close_matches(found[1], error.ctx.command.list_commands(error.ctx), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit with its code. args: the words after `marsexplorer`, those of the process by default."""
    words = sys.argv[1:] if args is None else args
    if words and words[0] in KEPT_BY_CTRL_C:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = cli.main(args, prog_name="marsexplorer", standalone_mode=False)
    except click.UsageError as error:
        hint = f" (see {error.ctx.command_path} --help)" if error.ctx else ""
        click.echo(f"marsexplorer: {error.format_message()}{_guess(error)}{hint}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        click.echo(f"marsexplorer: {error.format_message()}", err=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        if (sentence := missing_extra(error, words)) is None:
            raise
        click.echo(f"marsexplorer: {sentence}", err=True)
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)
