"""The catalogues of what participants read: whole, and as the code has it."""

import gettext
import json
import re
import sys
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from humanplay.study.translation import NOUNS
from humanplay.study.wording import CATALOGUES, catalogue, english, page_texts, shipped_languages
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import draw_catalogues  # noqa: E402

MARK = re.compile(r"\{\w+\}|<[^>]+>")
LANGUAGES = draw_catalogues.LANGUAGES


def edited(language):
    """The catalogue that is edited."""
    with (CATALOGUES / f"{language}.po").open("rb") as file:
        return read_po(file, locale=language)


def test_the_english_of_every_id_is_what_stands_in_the_code():
    assert english() == draw_catalogues.messages()


def test_no_text_of_a_page_is_out_of_reach_of_the_drawing():
    """A call that joins strings, or has another kind of quotes, would not be drawn."""
    for folder in draw_catalogues.PAGES:
        for path in sorted((ROOT / folder).glob("*.js")):
            source = path.read_text("utf-8")
            called = re.findall(r"(?<![\w.])(?:t|plural)\((?!ident)(.{0,40})", source)
            strange = [call for call in called if not call.startswith('"') and "${" not in call]
            assert strange == [], path


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_catalogue_lacks_nothing_and_leaves_placeholders_and_marks_as_they_are(language):
    catalog, wanted = edited(language), draw_catalogues.template()
    texts = {(message.context, message.id) for message in catalog if message.id}
    assert texts == {(message.context, message.id) for message in wanted if message.id}
    for message in catalog:
        if not message.id:
            continue
        assert message.string, message.id
        assert not message.fuzzy, message.id
        ours, theirs = set(MARK.findall(message.id)), set(MARK.findall(message.string))
        assert ours - NOUNS <= theirs <= ours, (message.context, ours, theirs)
        spaces = [(text[:1] == " ", text[-1:] == " ") for text in (message.id, message.string)]
        assert spaces[0] == spaces[1], message.context


@pytest.mark.parametrize(("language", "word"), [("de", "gelände"), ("es", "terreno")])
def test_only_the_task_with_terrains_speaks_of_one(language, word):
    """A translation has words that fit each task; English puts the task's own there."""
    of_all = {message.id for message in edited(language) if word in str(message.string).lower()}
    idents = {message.context for message in edited(language) if message.id in of_all}
    assert {ident for ident in idents if ident and not ident.startswith("mars.")} == set()
    of_mars = environment_of("mars").texts(EnvConfig())
    texts = {text for text in of_all if text in draw_catalogues.beginnings()}
    assert texts <= {of_mars.opening, *(question.question for question in of_mars.questions)}


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_server_reads_what_is_edited(language):
    compiled = catalogue(language)
    assert isinstance(compiled, gettext.GNUTranslations)
    for message in edited(language):
        if message.id and message.context:
            assert page_texts(language)[message.context] == message.string
        elif message.id:
            assert compiled.gettext(message.id) == message.string


def test_the_languages_say_that_nobody_has_checked_them():
    assert shipped_languages() == sorted(LANGUAGES)
    for language in LANGUAGES:
        head = (CATALOGUES / f"{language}.po").read_text("utf-8").splitlines()[0]
        assert "machine-translated, unchecked" in head


def test_messages_are_sorted_and_readable():
    idents = list(json.loads((CATALOGUES / "messages.json").read_text("utf-8")))
    assert idents == sorted(idents)
