"""The places of a study with a cap: each consent takes one.

Whoever agreed goes on, whatever becomes of their place.
"""

from __future__ import annotations

from collections.abc import Iterator

from humanplay.db.reader import Reader
from humanplay.db.series import count_places
from humanplay.study.folder import Study
from humanplay.study.protocol import Protocol
from humanplay.study.screening import minutes_in_all
from humanplay.task import counted


def places_taken(reader: Reader, study: Study, now_ms: int) -> int:
    """How many places are taken now.

    Whoever finished has one, and whoever agreed less than `place_minutes` ago.
    """
    minutes = study.protocol.place_minutes
    since_ms = None if minutes is None else now_ms - round(60_000 * minutes)
    return count_places(reader, study.name, since_ms)


def is_full(reader: Reader, study: Study, now_ms: int) -> bool:
    """Whether nobody else may agree now."""
    cap = study.protocol.cap
    return cap is not None and places_taken(reader, study, now_ms) >= cap


def cap_in_words(protocol: Protocol) -> str:
    """How many people may agree, in sentences; empty without a cap."""
    if protocol.cap is None:
        return ""
    people = counted(protocol.cap, "person", "people")
    if protocol.place_minutes is None:
        return f"At most {people} can agree to take part; each keeps their place."
    minutes = f"{protocol.place_minutes:g} minute{'s' * (protocol.place_minutes != 1)}"
    return (
        f"At most {people} can agree to take part. The place of somebody who has not finished is free again {minutes} "
        "after they agreed; they may still go on."
    )


def cap_cautions(protocol: Protocol) -> Iterator[str]:
    """Yield what speaks against the cap of a protocol, a sentence each."""
    whole_min = minutes_in_all(protocol)
    if protocol.place_minutes is not None and protocol.place_minutes < whole_min:
        yield (
            f"a place is free again after {protocol.place_minutes:g} of about {whole_min:.0f} minutes that taking part "
            f"needs, so that more than {protocol.cap} may finish: raise place_minutes"
        )
