"""How people come into a study: by single-use invitations, from a panel's link, or by a link that is open to all.

An invitation and a panel's id are used up by the consent, in its transaction, and by nothing before it. Scripts are let in
whatever the recruitment, since they enter no human score. A join that is refused is noted with the participant who was there
before, without anything of whoever came second.

A session is supervised by the operator's code of the day, typed in the lab under the operator's eyes. The code is worth as
much as the operator's attention: whoever has seen it can type it elsewhere until it lapses.
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
from humanplay.study.protocol import StudyError

UNREADABLE = "the invitations of this study cannot be read now; tell whoever invited you"
NO_INVITATION = "this study is by invitation: open the link that you were sent"
WRONG_INVITATION = (
    "this is no invitation to this study: open the link that you were sent just as it stands, or ask whoever invited you for "
    "a new one"
)
REVOKED = "this invitation has been taken back: ask whoever sent it to you for a new one"
USED = (
    "this invitation has been used: if it was you, go on in the browser in which you began; otherwise ask whoever sent it to "
    "you for a new one"
)
OTHER_INVITATION = (
    "this browser takes part with another invitation already: to go on there, open the study without an invitation; for "
    "somebody else, use another browser or a private window"
)
WRONG_PANEL_LINK = (
    "this link was not made for this id: open the link that you were sent just as it stands, or ask whoever sent it to "
    "you for a new one"
)
UNFILLED = (
    "this link has {value} as {name}, which the recruitment platform should have replaced by your participant ID: accept the "
    "study on the platform and begin it there; if you did, tell whoever invited you that their link is not set up"
)
PREVIEW = (
    "you see a preview of {title}; nothing is recorded. {text} To take part, accept the task on the platform and "
    "begin it there"
)
EMPTY = "this link has no {name} after its =: begin the study on the platform that sent you"
REPEATED = (
    "this link has {name} more than once, so that it does not say who you are: begin the study on the platform that "
    "sent you"
)
LONGEST_ID = 200
TOO_LONG = (
    f"this link has a {{name}} of more than {LONGEST_ID} characters, which is no participant ID: open the link that you were "
    "sent just as it stands"
)
MISSHAPEN = "this link has a {name} that is none of {platform}'s: open the link there again, and do not change it"
KEPT_OUT = (
    "this study is for people who have not taken part before, and this {name} has: nothing is recorded; if you come from a "
    "recruitment platform, return the study there"
)
NO_ID = "open this study from the site that sent you: its link says who you are there, and this one does not"


@dataclass(frozen=True)
class Arrival:
    """What somebody brings who joins.

    outside_ids  parameters of the link
    script       what plays, when it is no person
    invitation   the token of the link
    repeated     parameters that the link has more than once
    """

    outside_ids: Mapping[str, str]
    script: str | None = None
    invitation: str | None = None
    repeated: frozenset[str] = frozenset()


class TakenError(StageError):
    """Somebody has come with this invitation or id before, or this browser takes part for somebody else.

    participant_id, reason  with whom it is noted, and as what
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
        """Note a TakenError of the block, after what the block wrote was taken back, and pass it on."""
        try:
            yield
        except TakenError as error:
            self.note(error.participant_id, error.reason, now)
            raise

    def note(self, participant_id: str, reason: Reason, now: int) -> None:
        """Note a further join with a participant, MAX_NOTED times at most."""
        if self._store.count_stage_events(participant_id, REPEATED_JOIN) < MAX_NOTED:
            self._store.add_stage_event(participant_id, now, REPEATED_JOIN, {"reason": reason})

    def admit(
        self, study: Study, player_id: str, comes: Arrival, found: Participant | None
    ) -> str | None:
        """Return the id of the invitation that a person comes with, None for none; StageError when they may not come in.

        found  the participant with this cookie, None before joining
        """
        _check_shapes(study, comes)
        self._check_outside_id(study, player_id, comes, found)
        own = None if found is None else found.invitation
        has_left = found is not None and found.stage == "withdrawn"
        if study.protocol.recruitment != "invitation" or has_left:
            return own
        if comes.invitation is None:
            if found is None:
                raise StageError(NO_INVITATION)
            return own
        return self._admit_invited(study, comes.invitation, found)

    def check_consent(self, study: Study, participant: Participant) -> None:
        """Check that a person may agree now, in the transaction that notes it; StageError when somebody else was first."""
        if study.protocol.recruitment == "invitation":
            invitation = self._read(study).get(participant.invitation or "")
            if invitation is None:
                raise StageError(NO_INVITATION)
            self._check_usable(study, invitation, participant)
        elif study.protocol.recruitment == "panel":
            name = study.protocol.outside_ids[0]
            value = self._store.identity(participant.id, name)
            if value is None:
                raise StageError(NO_ID)
            other = self._consented_with(study, name, value, participant.player_id)
            if other is not None:
                raise _taken_id(name, other)

    def obstacle(self, study: Study, participant: Participant) -> str | None:
        """Return why somebody at the consent cannot agree any more, in a sentence; None when nothing stands in the way."""
        if participant.stage != "consent" or participant.kind != "human" or not study.is_running:
            return None
        try:
            self.check_consent(study, participant)
        except StageError as error:
            return str(error)
        return None

    def repeats_outside_id(self, study: Study, outside_ids: Mapping[str, str]) -> str | None:
        """Return `missing`, `repeated` or `new` for the first outside id of somebody who comes; None where none is expected.

        It is expected where the link is open and the protocol names one. An id is repeated when somebody in the study has the
        same but for its case and spaces; that is noted with them as well.
        """
        if not study.protocol.outside_ids:
            return None
        name = study.protocol.outside_ids[0]
        if not plain(outside_ids.get(name, "")):
            return "missing" if study.protocol.recruitment == "open" else None
        others = self._store.identities(study.name, name)
        known = {plain(value) for _, value in others}
        return "repeated" if plain(outside_ids[name]) in known else "new"

    def note_repeated_id(self, study: Study, outside_ids: Mapping[str, str], now: int) -> None:
        """Note with everybody who has the first of these outside ids that it came again."""
        name = study.protocol.outside_ids[0]
        for other, value in self._store.identities(study.name, name):
            if plain(value) == plain(outside_ids[name]):
                self.note(other.id, "outside id", now)

    def _admit_invited(self, study: Study, token: str, found: Participant | None) -> str:
        try:
            invitation = self.invitations.read_token(study, token)
        except StudyError as error:
            raise StageError(UNREADABLE) from error
        if invitation is None:
            raise StageError(WRONG_INVITATION)
        if found is not None and found.consent_ms is not None:
            if found.invitation != invitation.id:
                raise TakenError(OTHER_INVITATION, found.id, "another invitation")
            return invitation.id
        self._check_usable(study, invitation, found)
        return invitation.id

    def _check_usable(
        self, study: Study, invitation: Invitation, found: Participant | None
    ) -> None:
        other = self._store.consented_with_invitation(study.name, invitation.id)
        if other is not None and (found is None or other.id != found.id):
            raise TakenError(USED, other.id, "invitation")
        if self._store.is_invitation_forgotten(study.name, invitation.id):
            raise StageError(USED)
        if invitation.revoked_ms is not None:
            raise StageError(REVOKED)

    def _check_outside_id(
        self, study: Study, player_id: str, comes: Arrival, found: Participant | None
    ) -> None:
        """Check that the first outside id and the cookie name the same person; StageError otherwise."""
        if not study.protocol.outside_ids:
            return
        name, is_panel = study.protocol.outside_ids[0], study.protocol.recruitment == "panel"
        value = comes.outside_ids.get(name)
        if value is None:
            if is_panel and found is None:
                raise StageError(NO_ID)
            return
        if found is None and is_kept_out(self._folder.path(study.name), value):
            raise StageError(KEPT_OUT.format(name=name))
        own = None if found is None else self._store.identity(found.id, name)
        if is_panel and study.protocol.panel_links == "signed" and own is None:
            given, signed = read_code(comes.invitation or ""), read_code(panel_token(study, value))
            if not hmac.compare_digest(given.encode(), signed.encode()):
                raise StageError(WRONG_PANEL_LINK)
        if is_panel:
            other = self._consented_with(study, name, value, player_id)
        else:
            other = self._store.participant_with_identity(study.name, name, value)
        if other is not None and other.player_id != player_id:
            raise _taken_id(name, other)
        if found is not None and own is not None and not _same(own, value, is_panel):
            message = f"this browser takes part for another {name} already: use another browser or a private window"
            raise TakenError(message, found.id, "another outside id")

    def _consented_with(
        self, study: Study, name: str, value: str, player_id: str
    ) -> Participant | None:
        """Return another person who has agreed with this outside id, whatever its case and spaces."""
        for other, known in self._store.identities(study.name, name):
            is_other = other.player_id != player_id and other.consent_ms is not None
            if is_other and plain(known) == plain(value):
                return other
        return None

    def _read(self, study: Study) -> Mapping[str, Invitation]:
        try:
            return self.invitations.of(study.name)
        except StudyError as error:
            raise StageError(UNREADABLE) from error


def panel_token(study: Study, value: str) -> str:
    """Return the signature (60 bits) under the study's secret of a panel's id, whatever its case and spaces."""
    return grouped(signature(study.secret, f"{study.protocol_hash}|panel|{plain(value)}", 12))


def panel_link(study: Study, value: str, base: str) -> str:
    """Return the link of a panel's id below the server's address `base`; StudyError where links are not signed or needed."""
    protocol = study.protocol
    if not study.is_running or (protocol.recruitment, protocol.panel_links) != ("panel", "signed"):
        raise StudyError(
            f"only an open study with recruitment panel and panel_links signed takes signed ids; {study.name!r} is "
            f"{study.status}, with {protocol.recruitment} and {protocol.panel_links}"
        )
    query = urlencode({protocol.outside_ids[0]: value, PARAMETER: panel_token(study, value)})
    return f"{base.rstrip('/')}/study/{study.name}?{query}"


def _check_shapes(study: Study, comes: Arrival) -> None:
    """StageError for a preview, and for an ID that names nobody of the platform."""
    protocol = study.protocol
    if NO_ASSIGNMENT in map(str.strip, comes.outside_ids.values()):
        text, _, _ = protocol.consent.text.partition("\n\n")
        raise StageError(PREVIEW.format(title=protocol.title, text=text))
    for name in protocol.outside_ids:
        if name in comes.repeated:
            raise StageError(REPEATED.format(name=name))
        value = comes.outside_ids.get(name)
        if value is None:
            continue
        if len(value) > LONGEST_ID:
            raise StageError(TOO_LONG.format(name=name))
        if not plain(value):
            raise StageError(EMPTY.format(name=name))
        if is_unfilled(value):
            raise StageError(UNFILLED.format(value=value.strip(), name=name))
        if not fits(protocol.platform, name, value):
            title = PLATFORMS[protocol.platform].title
            raise StageError(MISSHAPEN.format(name=name, platform=title))


def _same(one: str, other: str, is_panel: bool) -> bool:
    return plain(one) == plain(other) if is_panel else one == other


def _taken_id(name: str, other: Participant) -> TakenError:
    message = f"someone has joined with this {name} in another browser: go on there, or write to whoever invited you"
    return TakenError(message, other.id, "outside id")


MAX_WRONG_CODES = 10
"""Wrong codes of one participant after which no code of theirs is looked at."""

_WRONG_CODE = "wrong_code"
"""Kind of the stage event of a wrong code."""

_LENGTH = 8  # 40 bits
DAY_MS = 86_400_000


def code_of(study: Study, now_ms: int) -> str:
    """Return the operator's code of the UTC day that `now_ms` lies in, such as `7K3M-XWT5`."""
    day = datetime.fromtimestamp(now_ms / 1000, UTC).date().isoformat()
    return grouped(signature(study.secret, f"{study.protocol_hash}|supervise|{day}", _LENGTH))


def valid_until_ms(now_ms: int) -> int:
    """Return when the code of this day ends to be valid: at the end of the following UTC day."""
    day = datetime.combine(datetime.fromtimestamp(now_ms / 1000, UTC), datetime.min.time(), UTC)
    return int((day + timedelta(days=2)).timestamp() * 1000)


def supervised_until_ms(participant: Participant) -> int | None:
    """Return when the participant's supervision lapses or lapsed; None when the operator's code was never typed."""
    typed_ms = participant.supervised_ms
    return None if typed_ms is None else typed_ms + SUPERVISED_FOR_MS


def is_code(study: Study, typed: str, now_ms: int) -> bool:
    """Return whether somebody typed the operator's code of this UTC day or of the one before."""
    given = read_code(typed).encode()
    codes = [read_code(code_of(study, at)).encode() for at in (now_ms, now_ms - DAY_MS)]
    return any(hmac.compare_digest(given, code) for code in codes)


def supervise(
    study_store: StudyStore, study: Study, participant: Participant, typed: str, now_ms: int
) -> None:
    """Note that the operator typed their code for a person; StageError for a wrong one, which is noted too."""
    if participant.kind != "human":
        raise StageError("only a person's session can be supervised")
    if study_store.count_stage_events(participant.id, _WRONG_CODE) >= MAX_WRONG_CODES:
        what = "no code is looked at any more, go on without one"
        raise StageError(f"{MAX_WRONG_CODES} wrong codes were typed here: {what}")
    if not is_code(study, typed, now_ms):
        study_store.add_stage_event(participant.id, now_ms, _WRONG_CODE, {})
        raise StageError("this is not the operator's code of today: ask the operator to type it")
    study_store.note_supervised(participant.id, now_ms)
