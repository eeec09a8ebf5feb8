"""What speaks against a protocol that nevertheless holds."""

from __future__ import annotations

from collections.abc import Iterator

from humanplay.study.places import cap_cautions
from humanplay.study.protocol import Protocol
from humanplay.study.screening import attention_cautions, screening_cautions


def cautions_of(protocol: Protocol) -> Iterator[str]:
    """Yield the cautions that `study check` and freezing print, a sentence each."""
    yield from screening_cautions(protocol)
    yield from attention_cautions(protocol)
    yield from cap_cautions(protocol)
