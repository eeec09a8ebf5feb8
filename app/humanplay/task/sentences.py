"""Sentences that can be said in another language.

`humanplay.study.wording` says them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


class Sentence(str):
    """A text in English for a participant, by an ID under which catalogues have it.

    Whoever knows no language reads the English one, since it is a `str`.

    ident    of the text: `refused.closed`
    english  with its placeholders in braces
    values   of the placeholders; one that is a `Sentence` is translated, too
    """

    ident: str
    english: str
    values: Mapping[str, object]

    def __new__(cls, ident: str, english: str, **values: object) -> Sentence:
        """A text with its placeholders filled in; one without values is a template."""
        sentence = super().__new__(cls, english.format(**values) if values else english)
        sentence.ident, sentence.english, sentence.values = ident, english, values
        return sentence

    def __deepcopy__(self, _: object) -> Sentence:
        """Itself, as of any text."""
        return self

    def format(self, *_: object, **values: object) -> Sentence:
        """The text with its placeholders filled in, which have names."""
        return Sentence(self.ident, self.english, **values)


@dataclass(frozen=True)
class SentenceName:
    """A sentence's ID and placeholders, by which a page says it in its language.

    Both are None of a text that is no `Sentence`.
    """

    ident: str | None = None
    values: dict[str, str] | None = None

    @classmethod
    def of(cls, text: str) -> SentenceName:
        """The name of a text."""
        if not isinstance(text, Sentence):
            return cls()
        return cls(text.ident, {name: str(word) for name, word in text.values.items()})


def sentence_of(error: Exception) -> str:
    """What an error says, still as a `Sentence` if it was raised with one."""
    sentence: object = error.args[0] if error.args else ""
    return sentence if isinstance(sentence, str) else str(error)
