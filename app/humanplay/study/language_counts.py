"""How many people read which language, for reports and releases.

A language that one or two people read is joined with others, so that nobody stands alone with it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from humanplay.study.answer_counts import FEWEST

ANOTHER_LANGUAGE = "another language"


def count_languages(read: Iterable[str | None]) -> dict[str, int]:
    """Count the people who read each language, rare ones joined.

    Args:
        read: What each of them read; None where a release joined it with others.

    Returns:
        Language -> its people; empty if all are joined.
    """
    languages = list(read)
    named = Counter(language for language in languages if language is not None)
    joined = len(languages) - named.total()
    for language in sorted(named, key=lambda language: (named[language], language)):
        # whoever is joined alone stands alone: a language of more people joins them
        if named[language] >= FEWEST and not 0 < joined < FEWEST:
            break
        joined += named.pop(language)
    if not named:
        return {}
    return {**named, **({ANOTHER_LANGUAGE: joined} if joined else {})}
