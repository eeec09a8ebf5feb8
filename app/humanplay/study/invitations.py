"""Invitations to a study: single-use signed links, listed in the study's folder.

    NAME/invitations.json   each invitation by its id: when it was issued, and when it was revoked

A token is the invitation's id and a signature under the study's secret. So the file alone lets nobody
in, and a token can be computed again from secret and id. The database holds who has used an
invitation: consenting uses it up, opening its link does not.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from humanplay.db.reader import Reader
from humanplay.db.series import participants
from humanplay.db.study_rows import participant_label
from humanplay.study.files import iso, locked, ms_of, now_ms, read_object, stamp_of, write_object
from humanplay.study.folder import Folder, Study
from humanplay.study.protocol import StudyError
from humanplay.task import counted

MAX_INVITATIONS = 5_000
"""Most invitations of a study."""

PARAMETER = "invitation"
"""The parameter of the link that holds the token."""

ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Crockford's base 32, of which codes consist: without I, L, O and U. A typed I or L is read as 1, an O as 0."""

FIRST_LETTERS = "BCGHKPQRVWXYZ"
"""Of an id: it is no number and no month, which a reader of the table of links would change."""

_LOOK_ALIKES = str.maketrans("ILO", "110", " -_")
ID_LENGTH, _SIGNATURE_LENGTH = 4, 12  # 60 bits that nobody can guess


@dataclass(frozen=True, kw_only=True)
class Invitation:
    """An invitation; times are ISO 8601.

    Attributes:
        revoked_at: None while it holds.
        arm: To which the operator assigns the person; None: people are assigned by chance.
    """

    id: str
    issued_at: str
    revoked_at: str | None = None
    arm: str | None = None

    @property
    def issued_ms(self) -> int:
        """When it was issued, in milliseconds since 1970."""
        return ms_of(self.issued_at)

    @property
    def revoked_ms(self) -> int | None:
        """When it was revoked, in milliseconds since 1970; None while it holds."""
        return None if self.revoked_at is None else ms_of(self.revoked_at)


def new_id(taken: Container[str]) -> str:
    """A new id of four characters."""
    while True:
        rest = (secrets.choice(ALPHABET) for _ in range(ID_LENGTH - 1))
        if (ident := secrets.choice(FIRST_LETTERS) + "".join(rest)) not in taken:
            return ident


class Invitations:
    """The invitations of all studies in a folder; changed files are read again."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._read: dict[str, tuple[object, dict[str, Invitation]]] = {}

    def of(self, name: str) -> dict[str, Invitation]:
        """A study's invitations by id, in the order of issuing.

        Raises:
            StudyError: If the file is damaged.
        """
        path = self._path(name)
        stamp = stamp_of(path)
        read = self._read.get(name)
        if read is None or read[0] != stamp:
            try:
                rows = [] if stamp is None else read_object(path)["invitations"]
                if not isinstance(rows, list):
                    raise TypeError(f"invitations must be a list, got {type(rows).__name__}")
                by_id = {row["id"]: Invitation(**row) for row in rows}
                # a time that cannot be read is found now
                _ = [(invitation.issued_ms, invitation.revoked_ms) for invitation in by_id.values()]
            except (KeyError, TypeError, ValueError) as error:
                raise StudyError(f"{path} is damaged: {error!r}; restore a backup") from error
            read = self._read[name] = (stamp, by_id)
        return read[1]

    @contextmanager
    def _changing(self, name: str) -> Iterator[dict[str, Invitation]]:
        """Let the block change a study's invitations, and write them."""
        with locked(self._folder.path(name)):
            invitations = dict(self.of(name))
            yield invitations
            rows = [asdict(invitation) for invitation in invitations.values()]
            content = {"format": "humanplay-invitations-1", "invitations": rows}
            write_object(self._path(name), content)

    def _path(self, name: str) -> Path:
        return self._folder.path(name) / "invitations.json"

    def issue(self, name: str, count: int, arm: str | None = None) -> list[Invitation]:
        """Issue new invitations to an open study; StudyError if it takes none.

        Args:
            arm: As of `Invitation`.
        """
        study = self._folder.study(name)
        if not study.is_running:
            raise StudyError(f"the study {name!r} is closed: nobody can be invited to it any more")
        if study.protocol.recruitment != "invitation":
            raise StudyError(
                f"the study {name!r} has recruitment {study.protocol.recruitment!r}: its link is /study/{name}, and only "
                "a study that was made with `--recruitment invitation` has invitations"
            )
        arms = [possible.name for possible in study.protocol.arms]
        if arm is not None and arm not in arms:
            raise StudyError(
                f"the study {name!r} has no arm {arm!r}: there are {', '.join(arms) or 'none'}"
            )
        with self._changing(name) as invitations:
            room = MAX_INVITATIONS - len(invitations)
            if not 1 <= count <= room:
                raise StudyError(
                    f"expected 1 to {counted(room, 'further invitation')} (a study has at most {MAX_INVITATIONS}), got {count}"
                )
            before, now = len(invitations), iso(now_ms())
            for _ in range(count):
                ident = new_id(invitations)
                invitations[ident] = Invitation(id=ident, issued_at=now, arm=arm)
        return list(invitations.values())[before:]

    def revoke(self, name: str, idents: Sequence[str]) -> list[Invitation]:
        """Revoke invitations by their ids.

        A person who has consented with one can go on.

        Raises:
            StudyError: For an unknown id; then none is revoked.
        """
        if not self._folder.study(name).is_running:
            raise StudyError(
                f"the study {name!r} is closed: its invitations let nobody in, and none is left to take back"
            )
        # a whole token begins with the id
        wanted = [read_code(ident)[:ID_LENGTH] for ident in idents]
        with self._changing(name) as invitations:
            pairs = zip(idents, wanted, strict=True)
            if unknown := [typed for typed, ident in pairs if ident not in invitations]:
                raise StudyError(
                    f"the study {name!r} has no invitation {unknown[0]!r}: `humanplay study invite {name} --list` shows all"
                )
            now = iso(now_ms())
            for ident in wanted:
                revoked_at = invitations[ident].revoked_at or now
                invitations[ident] = replace(invitations[ident], revoked_at=revoked_at)
        return [invitations[ident] for ident in wanted]

    def note_used(self, name: str, idents: Iterable[str]) -> None:
        """Unmark used invitations as revoked: revoking them had no effect."""
        with self._changing(name) as invitations:
            for ident in invitations.keys() & set(idents):
                invitations[ident] = replace(invitations[ident], revoked_at=None)

    def read_token(self, study: Study, token: str) -> Invitation | None:
        """The invitation of a token, revoked or not; None for any other text."""
        typed = read_code(token)
        ident = typed[:ID_LENGTH]
        if not hmac.compare_digest(typed.encode(), _signed(study, ident).encode()):
            return None
        return self.of(study.name).get(ident)


def token_of(study: Study, ident: str) -> str:
    """Return the token of an invitation, such as `7K3M-XWT5-9ABC-2DEF`."""
    return grouped(_signed(study, ident))


def link_of(study: Study, ident: str, base: str) -> str:
    """Return the link of an invitation below the server's address `base`."""
    return f"{base.rstrip('/')}/study/{study.name}?{PARAMETER}={token_of(study, ident)}"


@dataclass(frozen=True)
class Use:
    """What somebody has done with an invitation.

    Attributes:
        state: `opened`: joined and not left again. `used`: consented.
        label: Of the participant.
    """

    state: Literal["opened", "used"]
    label: str
    at_ms: int


def uses_of(reader: Reader, name: str) -> dict[str, Use]:
    """Invitation id -> its use, for those with which somebody has come.

    If several people have opened one, it is used by the person who consented, else opened by the
    first one who has not left again.
    """
    uses: dict[str, Use] = {}
    for person in participants(reader, name):
        if person.invitation is None:
            continue
        if person.consent_ms is not None:
            uses[person.invitation] = Use("used", participant_label(person.id), person.consent_ms)
        elif person.stage != "withdrawn":
            use = Use("opened", participant_label(person.id), person.joined_ms)
            uses.setdefault(person.invitation, use)
    return uses


def state_of(
    invitation: Invitation, use: Use | None
) -> Literal["issued", "opened", "used", "revoked"]:
    """An invitation's state; one that was used and then revoked stays used."""
    if use is not None and use.state == "used":
        return "used"
    if invitation.revoked_ms is not None:
        return "revoked"
    return "issued" if use is None else use.state


def signature(secret: bytes, text: str, length: int) -> str:
    """`length` characters (5 bits each, at most 51) of HMAC-SHA256(secret, text)."""
    number = int.from_bytes(hmac.new(secret, text.encode(), hashlib.sha256).digest(), "big")
    return "".join(ALPHABET[number >> (256 - 5 * (i + 1)) & 31] for i in range(length))


def grouped(code: str) -> str:
    """Return a code in groups of four, as it is shown."""
    return "-".join(code[i : i + 4] for i in range(0, len(code), 4))


def read_code(typed: str) -> str:
    """A typed code in capitals, without spaces and dashes; I and L are 1, O is 0."""
    return typed.upper().translate(_LOOK_ALIKES)


def _signed(study: Study, ident: str) -> str:
    text = f"{study.protocol_hash}|invitation|{ident}"
    return ident + signature(study.secret, text, _SIGNATURE_LENGTH)
