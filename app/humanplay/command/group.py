"""A program of commands, each in a module that is imported when it is called.

So `--help` answers at once. Every failure ends with one sentence on stderr. Exit code 2: a command
cannot be carried out as typed, or needs an extra that is not installed; 1: a failure on the way;
130: Ctrl-C.
"""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import NoReturn

import click

from humanplay.command.extras import missing_extra

POSIX = ("fcntl", "grp", "pwd", "resource", "termios")
"""Modules of Python's own that Windows has not."""
COMPILED = "marsexplorer.compiled"
"""The module that cannot be imported where compiled rules cannot be kept."""
NEEDS_POSIX = (
    "needs Linux, macOS or WSL (Windows Subsystem for Linux); `import marsexplorer` and the commands "
    "`marsexplorer evaluate` and `marsexplorer policies` work here too"
)

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 110, "show_default": True}


@dataclass(frozen=True)
class Entry:
    """A command in its program's table.

    Attributes:
        module: Relative to the program's package; the command is the object with its name
            there, `import_release` for `import`.
        extra: Brings all that the command needs; "" where nothing is needed.
        line: Of the program's --help.
    """

    module: str
    extra: str
    line: str


class Commands(click.Group):
    """A group that imports a command's module only to run it or to show its help."""

    def __init__(self, *, package: str, table: Mapping[str, Entry], **rest: object) -> None:
        super().__init__(**rest)  # type: ignore[arg-type]
        self.package, self.table = package, table

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order of the table."""
        del ctx
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command's module and return the command; None for an unknown name."""
        del ctx
        if cmd_name not in self.table:
            return None
        module = import_module(f".{self.table[cmd_name].module}", self.package)
        command = getattr(module, "import_release" if cmd_name == "import" else cmd_name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.line) for name, entry in self.table.items()])


def _guess(error: click.UsageError) -> str:
    """Ask after the command that was meant, if one is near."""
    unknown = re.match(r"No such command '(.+)'", error.format_message())
    if unknown is None or error.ctx is None or not isinstance(error.ctx.command, click.Group):
        return ""
    near = difflib.get_close_matches(unknown[1], error.ctx.command.list_commands(error.ctx), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def run(group: Commands, name: str, words: Sequence[str]) -> NoReturn:
    """Run the command that the words name, and exit with its code."""
    try:
        code = group.main(words, prog_name=name, standalone_mode=False)
    except click.UsageError as error:
        hint = f" (see {error.ctx.command_path} --help)" if error.ctx else ""
        _end(name, f"{error.format_message()}{_guess(error)}{hint}", 2)
    except click.ClickException as error:
        _end(name, error.format_message(), 1)
    except ModuleNotFoundError as error:
        if error.name in POSIX:
            _end(name, f"{' '.join((name, *words[:1]))} {NEEDS_POSIX}", 2)
        command = next((word for word in words if word in group.table), "")
        extra = group.table[command].extra if command else ""
        sentence = missing_extra(error, f"{name} {command}".strip(), extra)
        if sentence is None:
            raise
        _end(name, sentence, 2)
    except ImportError as error:
        if error.name != COMPILED:
            raise
        _end(name, error.msg, 1)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


def _end(name: str, sentence: str, code: int) -> NoReturn:
    click.echo(f"{name}: {sentence}", err=True)
    sys.exit(code)
