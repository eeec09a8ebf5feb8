"""Studies in German, in Spanish, and in a language with very long words."""

import re

RETENTION = "protocol.declarations.retention"
CONTACT = "protocol.declarations.contact"
OFFERED = {
    "languages": ("en", "de", "es"),
    "translated_by": "shipped with the software: machine-translated",
    "checked_by": "nobody",
    "own_texts": {
        "de": {RETENTION: "zehn Jahre", CONTACT: "niemand, das ist ein Test"},
        "es": {RETENTION: "diez años", CONTACT: "nadie, es una prueba"},
    },
}
"""What a protocol needs to be offered in the shipped languages."""
KEPT = re.compile(r"(\{\w+\}|<[^>]+>)")
"""Placeholders and marks, which no translation changes."""


def pseudo(text):
    """A text as long as another language may have it.

    Up to 10 characters are doubled, up to 20 get 60 % more, others 30 %.
    """
    length = len(KEPT.sub("", text))
    more = 1.0 if length <= 10 else 0.6 if length <= 20 else 0.3
    return "".join(part if KEPT.fullmatch(part) else _long(part, more) for part in KEPT.split(text))


def _long(text, more):
    """A text with so many more of its letters, spread over its words."""
    due, letters = 0.0, []
    for letter in text:
        letters.append(letter)
        due += more
        if due >= 1 and letter.isalpha():
            letters.append(letter.lower())
            due -= 1
    return "".join(letters)
