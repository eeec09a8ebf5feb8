"""`make tables`: draw the documents' tables again from the code that they speak of.

A table stands between `<!-- drawn: NAME -->` and `<!-- end -->`; what is around it stays.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import click
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from humanplay.cli.main import cli as humanplay
from humanplay.command.group import Commands
from humanplay.db.columns import TABLES, bundle_table, markdown, markdown_tables
from humanplay.tasks.mars.cli import cli as marsexplorer
from humanplay.web.settings import DEFAULT_DATABASE, PREFIX, Limits, Settings

FOLDER = Path(__file__).parent
PAGES = ("data.md", "release.md", "settings.md", "commands.md")
BLOCK = re.compile(r"^<!-- drawn: (?P<name>[\w ]+) -->\n.*?^<!-- end -->$", re.M | re.S)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [list(head), ["---" for _ in head], *map(list, rows)]
    cells = [[" ".join(cell.split()).replace("|", "&#124;") for cell in line] for line in lines]
    return "\n".join(f"|{'|'.join(line)}|" for line in cells)


def columns_beyond_the_export(name: str) -> str:
    """The columns of a bundle's table that no export has."""
    exported = TABLES[name].names("export")
    return markdown(
        tuple(column for column in bundle_table(name)[1] if column.name not in exported)
    )


def settings(model: type[BaseModel], prefix: str) -> str:
    """Variable, default and meaning of each setting."""
    rows = []
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel):
            continue
        default = "" if field.default in (None, (), PydanticUndefined) else f"`{field.default}`"
        if field.default == DEFAULT_DATABASE:
            default = "`data/playground.db` in a checkout, else `playground.db`"
        rows.append((f"`{prefix}{name.upper()}`", default, field.description or ""))
    return table(("variable", "default", "what it is"), rows)


def commands_of(group: Commands, program: str) -> Iterator[tuple[str, click.Command]]:
    """Yield every command of a program with its whole name, those of groups too."""
    context = click.Context(group, info_name=program)
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        assert command is not None
        if isinstance(command, click.Group):
            for below, leaf in command.commands.items():
                yield f"{program} {word} {below}", leaf
        else:
            yield f"{program} {word}", command


def commands(group: Commands, program: str) -> str:
    """A section for each command: its usage, what it does, and its options."""
    sections = []
    for path, command in commands_of(group, program):
        context = click.Context(command, info_name=path)
        usage = " ".join(command.collect_usage_pieces(context))
        rows = []
        for parameter in command.get_params(context):
            name, meaning = parameter.get_help_record(context) or ("", "")
            # an argument explains itself in the usage, and every command has --help
            if meaning and "--help" not in parameter.opts:
                rows.append((f"`{name}`", meaning.replace("[", "\\[")))
        line = command.get_short_help_str(limit=200)
        section = f"### {path}\n{line}\n```text\n{path} {usage.strip()}\n```"
        options = f"\n\n{table(('option', 'what it does'), rows)}" if rows else ""
        sections.append(section + options)
    return "\n\n".join(sections)


DRAWN: Mapping[str, Callable[[], str]] = {
    "tables of the database": markdown_tables,
    "columns of episodes": lambda: markdown(TABLES["episodes"].columns("export")),
    "columns of steps": lambda: markdown(TABLES["steps"].columns("export")),
    "columns of episodes in a bundle": lambda: columns_beyond_the_export("episodes"),
    "columns of input events in a bundle": lambda: columns_beyond_the_export("input_events"),
    "settings": lambda: settings(Settings, PREFIX),
    "limits": lambda: settings(Limits, f"{PREFIX}LIMITS__"),
    "commands of humanplay": lambda: commands(humanplay, "humanplay"),
    "commands of marsexplorer": lambda: commands(marsexplorer, "marsexplorer"),
}


def redraw(text: str) -> str:
    """A document with its tables as the code has them; KeyError for one that nobody draws."""

    def block(match: re.Match[str]) -> str:
        return f"<!-- drawn: {match['name']} -->\n{DRAWN[match['name']]()}\n<!-- end -->"

    return BLOCK.sub(block, text)


def main() -> None:
    """Draw every table again where it stands."""
    for page in (FOLDER / name for name in PAGES):
        text = page.read_text()
        if (drawn := redraw(text)) != text:
            page.write_text(drawn)
            print(f"docs/{page.name}")


if __name__ == "__main__":
    main()
