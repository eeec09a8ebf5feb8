"""A sealed evaluation of agents: a study whose protocol has `agents`, in which nobody but holders of cards takes part.

It plays the ranked terrains of a study of people, which stay secret until the evaluation closes, or terrains of its own. The
operator issues cards, one for each author; a further one of the same author is numbered, has seen these instances, and never
ranks. A card's token is its id and a signature under the evaluation's secret, so the list alone lets nobody in:

    NAME/cards.json   each card by its id: its author, its number among that author's, when it was issued, and when revoked
"""

from __future__ import annotations

import hmac
import re
from dataclasses import dataclass, replace
from typing import Any

from humanplay.series.files import iso, now_ms
from humanplay.series.folder import Folder, Study
from humanplay.series.invitations import ID_LENGTH, Issued, IssuedList, new_id, signature
from humanplay.series.protocol import Agents, PairedStudy, Protocol, StudyError, default_protocol
from humanplay.task import Configuration

UNPAIRED = "the study {!r} was closed without --sealed, so that its terrains are known: these are others like them"
OPENING, RECEIPTS, POLICIES = "opening.json", "receipts", "policies.json"
COMPARISON = "comparison.json"
"""What a closed evaluation publishes, in its folder (`humanplay.release.receipts`)."""
SEEN_BEFORE = "has seen these instances"
_SIGNATURE_LENGTH = 20  # 100 bits that nobody can guess
_CONSENT = "Agents are evaluated here; no people take part."


@dataclass(frozen=True, kw_only=True)
class IssuedCard(Issued):
    """A card as the operator issued it; `number` counts the cards of its author from 1."""

    author: str
    number: int


def evaluation_of_study(folder: Folder, name: str, study: str, agents: Agents) -> Protocol:
    """Return the protocol of an evaluation on a study's ranked terrains, or on others like them where these are known."""
    of = folder.study(study)
    if of.protocol.agents is not None:
        raise StudyError(f"{study!r} is an evaluation: name the study whose terrains it plays")
    paired = PairedStudy(name=of.name, protocol_hash=of.protocol_hash, commitment=of.commitment)
    unpaired = "" if of.is_open else UNPAIRED.format(study)
    agents = agents.model_copy(update={"study": paired, "unpaired": unpaired})
    config, task = of.protocol.env_config, of.protocol.task
    policies = {"policies": of.protocol.policies, "debrief_policy": None}
    return evaluation_of_task(name, config, task, of.protocol.ranked, agents, **policies)


def evaluation_of_task(
    name: str, config: Configuration, task: str, instances: int, agents: Agents, **rest: Any
) -> Protocol:
    """Return the protocol of an evaluation of a task on so many instances."""
    fixed: dict[str, Any] = {
        "title": f"Agents: {name}", "warm_up": 0, "ranked": instances, "players": 1, "questions": (),
        "consent": {"text": _CONSENT}, "agents": agents.model_dump(),
    }  # fmt: skip
    return default_protocol(name, config, task, **{**fixed, **rest})


class CardList(IssuedList[IssuedCard]):
    """The cards of every evaluation in a folder."""

    name, kind = "cards", IssuedCard

    def issue(self, name: str, author: str) -> IssuedCard:
        """Issue a card to an author and return it, numbered among theirs; StudyError unless the evaluation is open."""
        study, author = self._folder.study(name), re.sub(r"\s+", " ", author).strip()
        if study.protocol.agents is None or not study.is_running:
            what = "no evaluation of agents" if study.protocol.agents is None else study.status
            raise StudyError(f"{name!r} is {what}: only an open evaluation has cards")
        if not (1 <= len(author) <= 100 and author.isprintable()):
            raise StudyError(f"an author is named by 1 to 100 printable characters, got {author!r}")
        with self._changing(name) as found:
            number, ident = (
                1 + sum(_same(each.author, author) for each in found.values()),
                new_id(found),
            )
            card = IssuedCard(id=ident, author=author, number=number, issued_at=iso(now_ms()))
            found[ident] = card
        return card

    def revoke(self, name: str, ident: str) -> IssuedCard:
        """Revoke a card and return it: nobody can go on with it, and it counts as it stands; StudyError for an unknown id."""
        self._folder.study(name)
        with self._changing(name) as found:
            if ident not in found:
                there = ", ".join(found) or "none"
                raise StudyError(f"the evaluation {name!r} has no card {ident!r}; it has {there}")
            at = found[ident].revoked_at or iso(now_ms())
            found[ident] = replace(found[ident], revoked_at=at)
        return found[ident]

    def read_token(self, study: Study, token: str) -> IssuedCard | None:
        """Return the card that a token was signed for and that holds; None for any other text."""
        ident = token[:ID_LENGTH]
        if not hmac.compare_digest(token.encode(), _signed(study, ident).encode()):
            return None
        card = self.of(study.name).get(ident)
        return None if card is None or card.revoked_at is not None else card


def card_link(study: Study, ident: str, base: str) -> str:
    """Return the base address of a card's routes on the server at `base`: whoever has it plays with the card."""
    return f"{base.rstrip('/')}/agents/{_signed(study, ident)}"


def _signed(study: Study, ident: str) -> str:
    text = f"{study.protocol_hash}|card|{ident}"
    return ident + signature(study.secret, text, _SIGNATURE_LENGTH)


def _same(one: str, other: str) -> bool:
    """Return whether two authors are one, whatever the case and the marks between the letters."""
    plain = [re.sub(r"\W+", "", each).casefold() for each in (one, other)]
    return plain[0] == plain[1] or one == other
