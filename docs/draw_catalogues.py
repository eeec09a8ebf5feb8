"""`make texts`: draw the catalogues of what participants read again from the code; the translations in them stay.

A text stands where it is used, with its ID: `t("consent.agree", "I agree")` in pages and modules, `Sentence(...)` in Python.
The texts with which a new protocol begins have no ID.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import click
from babel.messages.catalog import Catalog
from babel.messages.extract import extract_from_dir
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

from humanplay.study.shipped_questions import BLOCKS
from humanplay.study.texts import ERASURE, consent
from humanplay.study.translation import DRY_RUN
from humanplay.study.wording import CATALOGUES
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.about import OPENING, STUDY_TITLE
from marsexplorer.config import EnvConfig

ROOT = Path(__file__).parents[1]
LANGUAGES = ("de", "es")
PAGES = ("static/common", "static/study", "static/task/mars", "static/task/picture")
"""Folders whose modules and templates a participant's page consists of."""
KNOWN = ROOT / "app" / "humanplay" / "tasks" / "gymnasium" / "catalogue.toml"
"""What is known of common environments."""
MARS_ACTIONS = ("north", "east", "south", "west")
OF_ENVIRONMENTS = (
    *(
        "coverage",
        "return",
        "normalized score",
        "steps to 99 %",
        "steps",
        "score",
        "reached 99 %",
        "succeeded",
    ),
    *("ended by itself", "noop", "fire", "forward", "pickup", "drop", "toggle", "done"),
)
"""What environments call their figures and actions."""
OF_BLOCKS = (
    "title",
    "about",
    "intro",
    "question",
    "choices",
    "rows",
    "points",
    "low",
    "high",
    "unit",
)
_STRING = r"""(?:"((?:[^"\\]|\\.)*)"|'((?:[^'\\]|\\.)*)')"""
_TEXT = re.compile(rf"\bt\(\s*{_STRING},\s*{_STRING}")
_PLURAL = re.compile(rf"\bplural\(\s*{_STRING},[^\"]*?,\s*{_STRING},\s*{_STRING}")


def of_pages() -> Iterator[tuple[str, str]]:
    """The ID and the English of each text in pages and their modules."""
    for folder in PAGES:
        for path in sorted((ROOT / folder).glob("*")):
            if path.suffix not in (".js", ".html"):
                continue
            source = path.read_text("utf-8")
            for match in _TEXT.finditer(source):
                ident, text = map(_unquoted, _pairs(match))
                yield ident, text
            for match in _PLURAL.finditer(source):
                ident, one, other = map(_unquoted, _pairs(match))
                yield f"{ident}.one", one
                yield f"{ident}.other", other


def _pairs(match: re.Match[str]) -> list[str]:
    return [text for text in match.groups() if text is not None]


def _unquoted(text: str) -> str:
    return re.sub(r"\\(.)", r"\1", text)


def of_python() -> Iterator[tuple[str, str]]:
    """The same of the server's sentences."""
    folder = str(ROOT / "app" / "humanplay")
    keywords = {"Sentence": ((1, "c"), 2)}
    for _, _, text, _, ident in extract_from_dir(
        folder, method_map=[("**.py", "python")], keywords=keywords
    ):
        if ident is not None and isinstance(text, str):
            yield ident, text


def messages() -> dict[str, str]:
    """The English of each ID; ValueError where one ID has two texts."""
    found: dict[str, str] = {}
    for ident, text in (*of_pages(), *of_python()):
        if found.setdefault(ident, text) != text:
            raise ValueError(f"the ID {ident!r} has two texts: {found[ident]!r}, {text!r}")
    return dict(sorted(found.items()))


def beginnings() -> list[str]:
    """The texts with which new protocols begin, and those of known environments, each once."""
    mars = environment_of("mars").texts(EnvConfig())
    texts = [mars.study_title, STUDY_TITLE, DRY_RUN, ERASURE, "terrains", "rounds"]
    for things, opening in (("terrains", mars.opening), ("rounds", OPENING)):
        for asks, keeps in product((True, False), repeat=2):
            texts += consent(opening, asks, things, keeps).split("\n\n")
    for question in mars.questions:
        texts += [question.question, *question.choices, question.why]
    for block in BLOCKS.values():
        texts += _texts_in(block)
    known = tomllib.loads(KNOWN.read_text("utf-8"))["known"].values()
    for environment in known:
        texts += [environment.get("instructions", "")]
        texts += [action.replace("_", " ") for action in environment.get("actions", ())]
    texts += [*MARS_ACTIONS, *OF_ENVIRONMENTS]
    return [text for text in dict.fromkeys(texts) if re.search(r"[^\W\d_]", text)]


def _texts_in(content: object) -> Iterator[str]:
    """The texts in a block that participants read."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for name, part in content.items():
            if name == "questions" or name in OF_BLOCKS:
                yield from _texts_in(part)
    elif isinstance(content, list):
        for part in content:
            yield from _texts_in(part)


def template() -> Catalog:
    """The catalogue that translations begin with."""
    catalog = Catalog(project="humanplay", charset="utf-8", fuzzy=False)
    for ident, text in messages().items():
        catalog.add(text, context=ident)
    for text in beginnings():
        catalog.add(text)
    return catalog


@click.command()
def main() -> None:
    """Draw messages.json and the catalogues again, with the translations that they have."""
    source = template()
    CATALOGUES.mkdir(exist_ok=True)
    english = json.dumps(messages(), indent=1, ensure_ascii=False)
    (CATALOGUES / "messages.json").write_text(f"{english}\n", "utf-8")
    for language in LANGUAGES:
        path = CATALOGUES / f"{language}.po"
        with path.open("rb") as file:
            catalog = read_po(file, locale=language)
        catalog.update(source, no_fuzzy_matching=True, update_creation_date=False)
        catalog.obsolete.clear()
        catalog.last_translator = "nobody: machine-translated, unchecked"
        catalog.language_team = "none"
        catalog.msgid_bugs_address = ""
        with path.open("wb") as file:
            write_po(file, catalog, width=110, no_location=True)
        with path.with_suffix(".mo").open("wb") as file:
            write_mo(file, catalog)
        missing = [message.id for message in catalog if message.id and not message.string]
        click.echo(f"{path.name}: {len(catalog)} texts, {len(missing)} without a translation")


if __name__ == "__main__":
    main()
