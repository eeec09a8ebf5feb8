"""In which words a participant reads a study: the texts of one of its languages.

A catalogue is a gettext file in `languages/`: `LANGUAGE.po` is edited, and `LANGUAGE.mo` read. It has each text of the page
and each refusal under its ID as the context, and without a context the texts with which a new protocol begins.
`messages.json` has the English of every ID. `make texts` draws all but the translations from the code.
"""

from __future__ import annotations

import gettext
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from humanplay import STATIC
from humanplay.study.protocol import SOURCE_LANGUAGE, Protocol
from humanplay.task.sentences import Sentence

CATALOGUES = Path(__file__).parent / "languages"
OPENING = "protocol.consent.opening"
"""The ID of the first paragraph of a consent text, which a preview shows."""
UNCHECKED = "machine-translated, unchecked"
"""What freezing says of the shipped translations."""


@cache
def english() -> dict[str, str]:
    """The English of each text of the page and each refusal, by its ID."""
    texts: dict[str, str] = json.loads((CATALOGUES / "messages.json").read_text("utf-8"))
    return texts


def shipped_languages() -> list[str]:
    """The languages into which this software is translated."""
    return sorted(path.stem for path in CATALOGUES.glob("*.mo"))


@cache
def catalogue(language: str) -> gettext.NullTranslations | None:
    """The catalogue of a language; None if none is shipped."""
    if language not in shipped_languages():
        return None
    with (CATALOGUES / f"{language}.mo").open("rb") as file:
        translations = gettext.GNUTranslations(file)
    translations.add_fallback(_Absent())
    return translations


class _Absent(gettext.NullTranslations):
    """Answers "" for a text that a catalogue lacks."""

    # gettext itself answers the English text, which some translations equal

    def gettext(self, message: str) -> str:
        return ""

    def pgettext(self, context: str, message: str) -> str:
        return ""


@cache
def page_texts(language: str) -> dict[str, str]:
    """The texts of the page and the refusals, as far as this software has them."""
    if language == SOURCE_LANGUAGE:
        return english()
    translations = catalogue(language)
    if translations is None:
        return {}
    texts = {ident: translations.pgettext(ident, text) for ident, text in english().items()}
    return {ident: text for ident, text in texts.items() if text}


def translated(language: str, text: str, keeps_rest: bool = False) -> str | None:
    """A text that a protocol begins with, translated; None if it is not shipped.

    A text of several paragraphs may be translated by paragraphs.

    Args:
        keeps_rest: Whether a paragraph that is not shipped stays as it is.
    """
    translations = catalogue(language)
    if translations is None:
        return None
    if whole := translations.gettext(text):
        return whole
    parts = []
    for paragraph in text.split("\n\n"):
        # gettext has its own header under the empty text
        is_said = keeps_rest or not any(map(str.isalpha, paragraph))
        part = (translations.gettext(paragraph) if paragraph else "") or paragraph * is_said
        if paragraph and not part:
            return None
        parts.append(part)
    return "\n\n".join(parts)


@dataclass(frozen=True)
class Wording:
    """The texts that a participant reads in a language, by their IDs."""

    language: str
    texts: Mapping[str, str]

    def say(self, sentence: str) -> str:
        """A sentence in this language; a text that is no `Sentence` stays as it is."""
        if not isinstance(sentence, Sentence):
            return sentence
        template = self.texts.get(sentence.ident, sentence.english)
        if not sentence.values:
            return template
        values = {
            name: self.say(text) if isinstance(text, str) else text
            for name, text in sentence.values.items()
        }
        try:
            return template.format(**values)
        except (KeyError, IndexError, ValueError):  # frozen before the software named it so
            return str(sentence)

    def text(self, ident: str, text: str) -> str:
        """The text of an ID; `text` if there is none."""
        return self.texts.get(ident, text)


def texts_of_page(protocol: Protocol, texts: Mapping[str, str], language: str) -> dict[str, str]:
    """The texts of the environment's page; in English, with its word for a terrain."""
    environment = protocol.environment
    word = environment.texts(protocol.env_config).things.removesuffix("s")
    others = _folders_of_tasks() - {environment.assets}
    spoken = {name: text for name, text in texts.items() if name.partition(".")[0] not in others}
    if language != SOURCE_LANGUAGE:
        return spoken
    return {
        name: text.replace("terrain", word).replace("Terrain", word.capitalize())
        for name, text in spoken.items()
    }


def software_wording(language: str) -> Wording:
    """The words of this software, where no frozen study has others."""
    return Wording(language, {**english(), **page_texts(language)})


@cache
def _folders_of_tasks() -> frozenset[str]:
    return frozenset(path.name for path in (STATIC / "task").iterdir())


def wording_of(protocol: Protocol, language: str) -> Wording:
    """The frozen words of a study; what froze without them is in the software's."""
    frozen = protocol.texts.get(language, {})
    texts = texts_of_page(protocol, software_wording(language).texts, language) | frozen
    if consent := frozen.get("protocol.consent.text"):
        texts[OPENING], _, _ = consent.partition("\n\n")
    return Wording(language, texts)


def preferred(accepted: str, offered: Sequence[str]) -> str:
    """The offered language that an `Accept-Language` header likes best.

    The first one if it names none of them.
    """
    ranges: list[tuple[float, str]] = []
    for part in accepted.lower().split(","):
        tag, _, weight = (piece.strip() for piece in part.partition(";"))
        try:
            ranges.append((float(weight.removeprefix("q=") or 1), tag))
        except ValueError:
            continue
    for likes, tag in sorted(ranges, key=lambda choice: -choice[0]):
        base = tag.split("-")[0]
        near = [language for language in offered if language.lower().split("-")[0] == base]
        if likes > 0 and near:
            order = {base: 1, tag: 0}  # pt-PT is answered in itself, else in pt, else in pt-BR
            return min(near, key=lambda language: order.get(language.lower(), 2))
    return offered[0]
