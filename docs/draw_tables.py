"""`make tables`: draw the documents' tables and the page's API types again from the code that they speak of.

A table stands between `<!-- drawn: NAME -->` and `<!-- end -->`; what is around it stays. The types are a file of their own.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from humanplay.board import messages
from humanplay.cli.main import cli as humanplay
from humanplay.command.group import Commands
from humanplay.db.columns import TABLES, bundle_table, markdown, markdown_tables
from humanplay.study.draft import draft_text
from humanplay.study.protocol import default_protocol
from humanplay.task.registration import DEFAULT_TASK, environment_of
from humanplay.tasks.mars.cli import cli as marsexplorer
from humanplay.web.answers.openapi import answered_models, definitions
from humanplay.web.api_docs import answers_in_words, inputs_of
from humanplay.web.server import create_app
from humanplay.web.settings import DEFAULT_DATABASE, PREFIX, Limits, Settings
from marsexplorer.compat import DEFAULT_CONFIG, PRESETS

FOLDER = Path(__file__).parent
STATIC = FOLDER.parent / "static"
PAGES = (
    *("api.md", "data.md", "release.md", "settings.md", "commands.md"),
    *("from-mars-explorer.md", "draft.md"),
)
TYPES_HEAD = "// What the API answers and sockets carry, drawn from their own description: `make tables` draws it again."
OF_ENVIRONMENT = {
    "Frame": "Frame", "History": "MoveHistory", "Course": "Course", "FrameCourse": "Course", "Mistake": "Mars.Mistake",
}  # fmt: skip
"""Models that are each environment's own, and what a page that serves every one calls them."""
ENDS = ("bonus_reward", "collision_reward", "out_of_bounds_reward")
"""Rewards of the ends in the authors' world."""
OVER_SOCKETS = (
    messages.Act,
    messages.ClockState,
    messages.InputEvent,
    messages.EventsAnswer,
    messages.RepeatProgress,
)
"""Messages of a page's socket that no call answers."""
BLOCK = re.compile(r"^<!-- drawn: (?P<name>[\w ]+) -->\n.*?^<!-- end -->$", re.M | re.S)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [list(head), ["---" for _ in head], *map(list, rows)]
    cells = [[" ".join(cell.split()).replace("|", "&#124;") for cell in line] for line in lines]
    return "\n".join(f"|{'|'.join(line)}|" for line in cells)


def in_each_world() -> Mapping[str, str]:
    """TABLE.COLUMN -> what it means in any world, and in MarsExplorer if that differs."""
    general = {
        f"{table.name}.{column.name}": column.meaning
        for table in TABLES.values()
        for column in table.all
    }
    words = environment_of(DEFAULT_TASK).about.columns
    return {name: f"{general[name]}. In MarsExplorer: {meaning}" for name, meaning in words.items()}


def exported_columns(name: str) -> str:
    """The columns of an export's table."""
    return markdown(TABLES[name].columns("export", in_each_world()))


def columns_beyond_the_export(name: str) -> str:
    """The columns of a bundle's table that no export has."""
    exported = TABLES[name].names("export")
    return markdown(
        tuple(
            column
            for column in bundle_table(name, in_each_world())[1]
            if column.name not in exported
        )
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
        context = click.Context(command, info_name=path, show_default=True)
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
    "calls of the API": lambda: calls(),
    "tables of the database": markdown_tables,
    "columns of episodes": lambda: exported_columns("episodes"),
    "columns of steps": lambda: exported_columns("steps"),
    "columns of episodes in a bundle": lambda: columns_beyond_the_export("episodes"),
    "columns of input events in a bundle": lambda: columns_beyond_the_export("input_events"),
    "settings": lambda: settings(Settings, PREFIX),
    "limits": lambda: settings(Limits, f"{PREFIX}LIMITS__"),
    "commands of humanplay": lambda: commands(humanplay, "humanplay"),
    "commands of marsexplorer": lambda: commands(marsexplorer, "marsexplorer"),
    "presets": lambda: presets(),
    "a draft": lambda: draft(),
}


def draft() -> str:
    """The draft of a study of MarsExplorer by its defaults."""
    config = environment_of(DEFAULT_TASK).configuration({})
    text = draft_text(default_protocol("pilot", config, recruitment="invitation"))
    return f"```toml\n{text}```"


def presets() -> str:
    """The presets of the authors' world against the first; levels share a row."""
    head = (
        "preset",
        "class (commit)",
        "complete above",
        "state of the rover's cell",
        "ends",
        "differs in",
    )
    levels = [name for name in PRESETS if name.startswith("level-")]
    groups = [[name] for name in PRESETS if name not in levels]
    groups.insert([*PRESETS].index(levels[0]), levels)
    return table(head, [row_of_presets(names) for names in groups])


def row_of_presets(names: Sequence[str]) -> tuple[str, ...]:
    """The cells of presets that share a row."""
    chosen = [PRESETS[name] for name in names]
    ends, others = [], []
    for preset in chosen:
        conf = {**DEFAULT_CONFIG, **preset.changes}
        ends.append(", ".join(f"{conf[end]:+d}" for end in ENDS))
        others.append(
            {key: json.dumps(to) for key, to in preset.changes.items() if key not in ENDS}
        )
    words = [f"`{key}` {by_number([to[key] for to in others])}" for key in others[0]]
    return (
        " to ".join(f"`{name}`" for name in dict.fromkeys([names[0], names[-1]])),
        by_number([f"`{preset.class_name}` ({preset.commit})" for preset in chosen]),
        by_number([f"{preset.share:.0%}" for preset in chosen]),
        by_number([str(preset.rover) for preset in chosen]),
        by_number(ends),
        ", ".join(words),
    )


def by_number(texts: Sequence[str]) -> str:
    """One text if all are the same, else the distinct ones with their numbers."""
    numbers: dict[str, list[int]] = {}
    for number, text in enumerate(texts, 1):
        numbers.setdefault(text, []).append(number)
    if len(numbers) == 1:
        return texts[0]
    return " or ".join(f"{text} ({', '.join(map(str, those))})" for text, those in numbers.items())


def redraw(text: str) -> str:
    """A document with its tables as the code has them; KeyError for one that nobody draws."""

    def block(match: re.Match[str]) -> str:
        return f"<!-- drawn: {match['name']} -->\n{DRAWN[match['name']]()}\n<!-- end -->"

    return BLOCK.sub(block, text)


def described_app(task: str, admin: bool = False) -> dict[str, Any]:
    """The API's description on a server of a task; `admin`: one with an operator's page."""
    with TemporaryDirectory() as folder:
        settings = Settings(database=Path(folder) / "a.db", task=task, admin=admin)
        return create_app(settings).openapi()


def calls() -> str:
    """What each call takes and answers, as the API's own description says; a card's calls are listed under its address."""
    description = described_app(DEFAULT_TASK)
    models = description["components"]["schemas"]
    rows = [
        (
            f"`{method.upper()} {path}`",
            " ".join(f"`{name}`" for fields in inputs_of(operation, models) for name, _ in fields),
            answers_in_words(operation),
            operation["summary"],
        )
        for path, operations in description["paths"].items()
        if not path.startswith("/agents/{token}")
        for method, operation in operations.items()
    ]
    return table(("call", "takes", "answers", "what it is"), rows)


def type_of(schema: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """The TypeScript type of a schema; `names` are those of models that the page calls otherwise."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return names.get(name, name)
    if "anyOf" in schema:
        return " | ".join(type_of(part, names) for part in schema["anyOf"])
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return " | ".join(json.dumps(value) for value in values)
    if "prefixItems" in schema:
        return f"[{', '.join(type_of(part, names) for part in schema['prefixItems'])}]"
    if schema["type"] == "array":
        part = type_of(schema["items"], names)
        return f"({part})[]" if "|" in part else f"{part}[]"
    if schema["type"] == "object":
        others = schema["additionalProperties"]
        return f"Record<string, {'unknown' if others is True else type_of(others, names)}>"
    plain = {"integer": "number", "number": "number", "string": "string", "boolean": "boolean"}
    return plain.get(schema["type"], "null")


def typed(name: str, model: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """A model as a TypeScript type, each field below its description."""
    lines = [f"  /** {' '.join(model['description'].split())} */", f"  type {name} = {{"]
    for field, schema in model["properties"].items():
        if "description" in schema:
            lines.append(f"    /** {schema['description']} */")
        mark = "" if field in model.get("required", ()) else "?"
        lines.append(f"    {field}{mark}: {type_of(schema, names)},")
    return "\n".join([*lines, "  };"])


def namespace(name: str, models: Iterable[str]) -> str:
    """Types under a name of their own."""
    return "\n".join([f"declare namespace {name} {{", *models, "}"])


def api_types() -> dict[str, str]:
    """What the API answers and sockets carry, as types of the page: the text of each file below `static`."""
    apps = {
        "mars": described_app(DEFAULT_TASK),
        "picture": described_app("gymnasium:FrozenLake-v1"),
    }
    schemas = apps["mars"]["components"]["schemas"]
    sockets = definitions(list(OVER_SOCKETS))
    answers = [
        typed(name, schemas[name], OF_ENVIRONMENT)
        for name in answered_models(apps["mars"])
        if name not in OF_ENVIRONMENT
    ]
    carried = [typed(name, sockets[name], {}) for name in sorted(sockets)]
    common = [TYPES_HEAD, namespace("Answers", answers), namespace("Socket", carried)]
    files = {
        "common/answers.d.ts": "\n\n".join(common) + "\n",
        "admin/types.d.ts": operators_types(answered_models(apps["mars"])),
    }
    for assets, description in apps.items():
        models = description["components"]["schemas"]
        own = [
            typed(model.removeprefix("Frame") or model, models[model], {})
            for model in OF_ENVIRONMENT
            if model in models
        ]
        text = f"{TYPES_HEAD}\n\n{namespace(assets.capitalize(), own)}\n"
        files[f"task/{assets}/messages.d.ts"] = text
    return files


def operators_types(shared: Iterable[str]) -> str:
    """What only the operator is answered; `shared` are the models of everybody's answers."""
    description = described_app(DEFAULT_TASK, admin=True)
    schemas = description["components"]["schemas"]
    names = {name: f"Answers.{name}" for name in shared}
    models = [
        typed(name, schemas[name], names)
        for name in answered_models(description)
        if name not in names
    ]
    return f"{TYPES_HEAD}\n\n{namespace('Admin', models)}\n"


def main() -> None:
    """Draw every table again where it stands, and the types."""
    for name, text in api_types().items():
        path = STATIC / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
            print(f"static/{name}")
    for page in (FOLDER / name for name in PAGES):
        text = page.read_text()
        if (drawn := redraw(text)) != text:
            page.write_text(drawn)
            print(f"docs/{page.name}")


if __name__ == "__main__":
    main()
