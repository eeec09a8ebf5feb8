"""Who may join a study: by an invitation, a platform's link, or an open link.

The consent uses up an invitation or a platform's ID, in its own transaction; nothing before it does.
Scripts may always join, since they enter no human score. A refused join is noted with the participant
who came first; nothing of the second person is stored.

A session is supervised if the operator's code of the day was typed in it, in the lab. The code is
worth as much as the operator's attention: whoever sees it can type it elsewhere until it lapses.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from urllib.parse import urlencode

from humanplay.board.attestation import SUPERVISED_FOR_MS
from humanplay.db.series import StudyStore
from humanplay.db.study_rows import Participant
from humanplay.study.flow import MAX_NOTED, REPEATED_JOIN, Reason
from humanplay.study.folder import Folder, Study
from humanplay.study.invitations import (
    PARAMETER,
    Invitation,
    Invitations,
    grouped,
    read_code,
    signature,
)
from humanplay.study.kept_out import is_kept_out
from humanplay.study.participation import StageError
from humanplay.study.platforms import NO_ASSIGNMENT, PLATFORMS, fits, is_unfilled, plain
from humanplay.study.protocol import SOURCE_LANGUAGE, StudyError
from humanplay.study.translation import own_sentence
from humanplay.study.wording import OPENING
from humanplay.task.sentences import Sentence, sentence_of

UNREADABLE = Sentence(
    "refused.unreadable",
    "the invitations of this study cannot be read now; tell whoever invited you",
)
NO_INVITATION = Sentence(
    "refused.no_invitation", "this study is by invitation: open the link that you were sent"
)
WRONG_INVITATION = Sentence(
    "refused.wrong_invitation",
    "this is no invitation to this study: open the link that you were sent just as it stands, or ask whoever invited you for "
    "a new one",
)
REVOKED = Sentence(
    "refused.revoked",
    "this invitation has been taken back: ask whoever sent it to you for a new one",
)
USED = Sentence(
    "refused.used",
    "this invitation has been used: if it was you, go on in the browser in which you began; otherwise ask whoever sent it to "
    "you for a new one",
)
OTHER_INVITATION = Sentence(
    "refused.other_invitation",
    "this browser takes part with another invitation already: to go on there, open the study without an invitation; for "
    "somebody else, use another browser or a private window",
)
WRONG_PANEL_LINK = Sentence(
    "refused.wrong_panel_link",
    "this link was not made for this id: open the link that you were sent just as it stands, or ask whoever sent it to "
    "you for a new one",
)
UNFILLED = Sentence(
    "refused.unfilled",
    "this link has {value} as {name}, which the recruitment platform should have replaced by your participant ID: accept the "
    "study on the platform and begin it there; if you did, tell whoever invited you that their link is not set up",
)
PREVIEW = Sentence(
    "refused.preview",
    "you see a preview of {title}; nothing is recorded. {text} To take part, accept the task on the platform and "
    "begin it there",
)
EMPTY = Sentence(
    "refused.empty",
    "this link has no {name} after its =: begin the study on the platform that sent you",
)
REPEATED = Sentence(
    "refused.repeated",
    "this link has {name} more than once, so that it does not say who you are: begin the study on the platform that "
    "sent you",
)
LONGEST_ID = 200
TOO_LONG = Sentence(
    "refused.too_long",
    "this link has a {name} of more than {most} characters, which is no participant ID: open the link that you were "
    "sent just as it stands",
)
MISSHAPEN = Sentence(
    "refused.misshapen",
    "this link has a {name} that is none of {platform}'s: open the link there again, and do not change it",
)
KEPT_OUT = Sentence(
    "refused.kept_out",
    "this study is for people who have not taken part before, and this {name} has: nothing is recorded; if you come from a "
    "recruitment platform, return the study there",
)
OTHER_ID = Sentence(
    "refused.other_id",
    "this browser takes part for another {name} already: use another browser or a private window",
)
TAKEN_ID = Sentence(
    "refused.taken_id",
    "someone has joined with this {name} in another browser: go on there, or write to whoever invited you",
)
NO_ID = Sentence(
    "refused.no_id",
    "open this study from the site that sent you: its link says who you are there, and this one does not",
)

NO_MORE_CODES = Sentence(
    "refused.no_more_codes",
    "{most} wrong codes were typed here: no code is looked at any more, go on without one",
)
WRONG_OPERATOR_CODE = Sentence(
    "refused.operator_code",
    "this is not the operator's code of today: ask the operator to type it",
)


@dataclass(frozen=True)
class Arrival:
    """What a person or a script brings who joins.

    outside_ids  the link's parameters
    script       the program that plays; None for a person
    invitation   the link's token
    repeated     the parameters that the link has more than once
    language     the language in which the page is read first
    """

    outside_ids: Mapping[str, str]
    script: str | None = None
    invitation: str | None = None
    repeated: frozenset[str] = frozenset()
    language: str = SOURCE_LANGUAGE


class TakenError(StageError):
    """The invitation, the ID or the browser belongs to another participant.

    participant_id  the participant with whom it is noted
    reason          as what it is noted
    """

    def __init__(self, message: str, participant_id: str, reason: Reason) -> None:
        super().__init__(message)
        self.participant_id, self.reason = participant_id, reason


class Recruitment:
    """Lets people into the studies of one server."""

    def __init__(self, folder: Folder, study_store: StudyStore) -> None:
        self.invitations, self._folder = Invitations(folder), folder
        self._store = study_store

    @contextmanager
    def noting(self, now: int) -> Iterator[None]:
        """Note a TakenError of the `with` block, and raise it again.

        Put the block's transaction inside, so that what it wrote is rolled back first.
        """
        try:
            yield
        except TakenError as error:
            self.note(error.participant_id, error.reason, now)
            raise

    def note(self, participant_id: str, reason: Reason, now: int) -> None:
        """Note a further join with a participant, at most MAX_NOTED times."""
        if self._store.count_stage_events(participant_id, REPEATED_JOIN) < MAX_NOTED:
            self._store.add_stage_event(participant_id, now, REPEATED_JOIN, {"reason": reason})

    def admit(
        self, study: Study, player_id: str, arrival: Arrival, returning: Participant | None
    ) -> str | None:
        """Check that a person may come in.

        Args:
            returning: The participant with this cookie; None if there is none yet.

        Returns:
            The ID of their invitation; None without one.

        Raises:
            StageError: If they may not.
        """
        _check_link(study, arrival)
        self._check_outside_id(study, player_id, arrival, returning)
        present_invitation = None if returning is None else returning.invitation
        has_left = returning is not None and returning.stage == "withdrawn"
        if study.protocol.recruitment != "invitation" or has_left:
            return present_invitation
        if arrival.invitation is None:
            if returning is None:
                raise StageError(NO_INVITATION)
            return present_invitation
        return self._admit_invited(study, arrival.invitation, returning)

    def check_consent(self, study: Study, participant: Participant) -> None:
        """Check that a person may agree now; StageError if somebody else was first.

        Call it in the transaction that stores the consent.
        """
        if study.protocol.recruitment == "invitation":
            invitation = self._read(study).get(participant.invitation or "")
            if invitation is None:
                raise StageError(NO_INVITATION)
            self._check_usable(study, invitation, participant)
        elif study.protocol.recruitment == "panel":
            name = study.protocol.outside_ids[0]
            outside_id = self._store.identity(participant.id, name)
            if outside_id is None:
                raise StageError(NO_ID)
            other = self._consented_with(study, name, outside_id, participant.player_id)
            if other is not None:
                raise _taken_id(name, other)

    def obstacle(self, study: Study, participant: Participant) -> str | None:
        """Why a participant at the consent cannot agree any more; None if they can."""
        if participant.stage != "consent" or participant.kind != "human" or not study.is_running:
            return None
        try:
            self.check_consent(study, participant)
        except StageError as error:
            return sentence_of(error)
        return None

    def newness_of_id(self, study: Study, outside_ids: Mapping[str, str]) -> str | None:
        """Whether the participant ID of a newcomer is new in the study.

        Case and spaces make no difference.

        Returns:
            `new`, `repeated`, or `missing` where an open link should have brought one; None if the
            protocol names no ID, or none came with an invitation.
        """
        if not study.protocol.outside_ids:
            return None
        name = study.protocol.outside_ids[0]
        if not plain(outside_ids.get(name, "")):
            return "missing" if study.protocol.recruitment == "open" else None
        stored_ids = {plain(stored) for _, stored in self._store.identities(study.name, name)}
        return "repeated" if plain(outside_ids[name]) in stored_ids else "new"

    def note_repeated_id(self, study: Study, outside_ids: Mapping[str, str], now: int) -> None:
        """Note a repeated participant ID with everybody who has it."""
        name = study.protocol.outside_ids[0]
        for other, stored_id in self._store.identities(study.name, name):
            if plain(stored_id) == plain(outside_ids[name]):
                self.note(other.id, "outside id", now)

    def _admit_invited(self, study: Study, token: str, returning: Participant | None) -> str:
        """The ID of the invitation with a token; StageError if it lets nobody in."""
        try:
            invitation = self.invitations.read_token(study, token)
        except StudyError as error:
            raise StageError(UNREADABLE) from error
        if invitation is None:
            raise StageError(WRONG_INVITATION)
        if returning is not None and returning.consent_ms is not None:
            if returning.invitation != invitation.id:
                raise TakenError(OTHER_INVITATION, returning.id, "another invitation")
            return invitation.id
        self._check_usable(study, invitation, returning)
        return invitation.id

    def _check_usable(
        self, study: Study, invitation: Invitation, returning: Participant | None
    ) -> None:
        other = self._store.consented_with_invitation(study.name, invitation.id)
        if other is not None and (returning is None or other.id != returning.id):
            raise TakenError(USED, other.id, "invitation")
        if self._store.is_invitation_forgotten(study.name, invitation.id):
            raise StageError(USED)
        if invitation.revoked_ms is not None:
            raise StageError(REVOKED)

    def _check_outside_id(
        self, study: Study, player_id: str, arrival: Arrival, returning: Participant | None
    ) -> None:
        """Check that the participant ID and the cookie name the same person.

        Raises:
            StageError: If they do not, or the ID may not take part.
        """
        if not study.protocol.outside_ids:
            return
        name, is_panel = study.protocol.outside_ids[0], study.protocol.recruitment == "panel"
        outside_id = arrival.outside_ids.get(name)
        if outside_id is None:
            if is_panel and returning is None:
                raise StageError(NO_ID)
            return
        if returning is None and is_kept_out(self._folder.path(study.name), outside_id):
            raise StageError(KEPT_OUT.format(name=name))
        stored_id = None if returning is None else self._store.identity(returning.id, name)
        if is_panel and study.protocol.panel_links == "signed" and stored_id is None:
            token = read_code(arrival.invitation or "")
            signed = read_code(panel_token(study, outside_id))
            if not hmac.compare_digest(token.encode(), signed.encode()):
                raise StageError(WRONG_PANEL_LINK)
        if is_panel:
            other = self._consented_with(study, name, outside_id, player_id)
        else:
            other = self._store.participant_with_identity(study.name, name, outside_id)
        if other is not None and other.player_id != player_id:
            raise _taken_id(name, other)
        if returning is None or stored_id is None:
            return
        if not _is_same_id(stored_id, outside_id, is_panel):
            message = OTHER_ID.format(name=name)
            raise TakenError(message, returning.id, "another outside id")

    def _consented_with(
        self, study: Study, name: str, outside_id: str, player_id: str
    ) -> Participant | None:
        """Another person who has agreed with this ID, whatever its case and spaces."""
        for other, stored_id in self._store.identities(study.name, name):
            has_agreed = other.player_id != player_id and other.consent_ms is not None
            if has_agreed and plain(stored_id) == plain(outside_id):
                return other
        return None

    def _read(self, study: Study) -> Mapping[str, Invitation]:
        try:
            return self.invitations.of(study.name)
        except StudyError as error:
            raise StageError(UNREADABLE) from error


def panel_token(study: Study, outside_id: str) -> str:
    """The signature (60 bits) of a platform's ID, whatever its case and spaces."""
    return grouped(signature(study.secret, f"{study.protocol_hash}|panel|{plain(outside_id)}", 12))


def panel_link(study: Study, outside_id: str, base: str) -> str:
    """The signed link for a platform's ID.

    Args:
        base: The server's address.

    Raises:
        StudyError: If the study takes no signed links.
    """
    protocol = study.protocol
    if not study.is_running or (protocol.recruitment, protocol.panel_links) != ("panel", "signed"):
        raise StudyError(
            f"only an open study with recruitment panel and panel_links signed takes signed ids; {study.name!r} is "
            f"{study.status}, with {protocol.recruitment} and {protocol.panel_links}"
        )
    token = panel_token(study, outside_id)
    query = urlencode({protocol.outside_ids[0]: outside_id, PARAMETER: token})
    return f"{base.rstrip('/')}/study/{study.name}?{query}"


def _check_link(study: Study, arrival: Arrival) -> None:
    """StageError for a platform's preview, and for a value that is none of its IDs."""
    protocol = study.protocol
    if NO_ASSIGNMENT in map(str.strip, arrival.outside_ids.values()):
        text, _, _ = protocol.consent.text.partition("\n\n")
        study_title = own_sentence("title", protocol.title)
        raise StageError(PREVIEW.format(title=study_title, text=Sentence(OPENING, text)))
    for name in protocol.outside_ids:
        if name in arrival.repeated:
            raise StageError(REPEATED.format(name=name))
        outside_id = arrival.outside_ids.get(name)
        if outside_id is None:
            continue
        if len(outside_id) > LONGEST_ID:
            raise StageError(TOO_LONG.format(name=name, most=LONGEST_ID))
        if not plain(outside_id):
            raise StageError(EMPTY.format(name=name))
        if is_unfilled(outside_id):
            raise StageError(UNFILLED.format(value=outside_id.strip(), name=name))
        if not fits(protocol.platform, name, outside_id):
            title = PLATFORMS[protocol.platform].title
            raise StageError(MISSHAPEN.format(name=name, platform=title))


def _is_same_id(one: str, other: str, is_panel: bool) -> bool:
    return plain(one) == plain(other) if is_panel else one == other


def _taken_id(name: str, other: Participant) -> TakenError:
    return TakenError(TAKEN_ID.format(name=name), other.id, "outside id")


MAX_WRONG_CODES = 10
"""After so many wrong codes, no further code of a participant is checked."""

_WRONG_CODE = "wrong_code"
"""Kind of the stage event of a wrong code."""

_LENGTH = 8
"""Characters of the operator's code: 40 bits."""
DAY_MS = 86_400_000


def code_of(study: Study, now_ms: int) -> str:
    """The operator's code of the UTC day of `now_ms`, such as `7K3M-XWT5`."""
    day = datetime.fromtimestamp(now_ms / 1000, UTC).date().isoformat()
    return grouped(signature(study.secret, f"{study.protocol_hash}|supervise|{day}", _LENGTH))


def valid_until_ms(now_ms: int) -> int:
    """Until when the day's code is valid: the end of the following UTC day."""
    day = datetime.combine(datetime.fromtimestamp(now_ms / 1000, UTC), datetime.min.time(), UTC)
    return int((day + timedelta(days=2)).timestamp() * 1000)


def supervised_until_ms(participant: Participant) -> int | None:
    """When the participant's supervision lapses; None if it never began."""
    typed_ms = participant.supervised_ms
    return None if typed_ms is None else typed_ms + SUPERVISED_FOR_MS


def is_code(study: Study, typed: str, now_ms: int) -> bool:
    """Whether somebody typed the operator's code of this UTC day or of the day before."""
    typed_code = read_code(typed).encode()
    codes = [read_code(code_of(study, ms)).encode() for ms in (now_ms, now_ms - DAY_MS)]
    return any(hmac.compare_digest(typed_code, code) for code in codes)


def supervise(
    study_store: StudyStore, study: Study, participant: Participant, typed: str, now_ms: int
) -> None:
    """Note that the operator typed their code for a participant.

    Raises:
        StageError: For a wrong code, which is noted too.
    """
    if participant.kind != "human":
        raise StageError("only a person's session can be supervised")
    if study_store.count_stage_events(participant.id, _WRONG_CODE) >= MAX_WRONG_CODES:
        raise StageError(NO_MORE_CODES.format(most=MAX_WRONG_CODES))
    if not is_code(study, typed, now_ms):
        study_store.add_stage_event(participant.id, now_ms, _WRONG_CODE, {})
        raise StageError(WRONG_OPERATOR_CODE)
    study_store.note_supervised(participant.id, now_ms)
