"""Invitations to a study: single-use signed links, listed in the study's folder.

    NAME/invitations.json   each invitation by its id: when it was issued, and when it was revoked

A token is the invitation's id and a signature under the study's secret, so the file alone lets nobody in, and a token can be
made again from secret and id. Who has used an invitation is in the database, with the participant: agreeing to the consent
text uses it up, opening its link does not.
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

    revoked_at  None while it holds
    arm         to which the operator assigns whoever comes with it; None: people are assigned by chance
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


def new_id(known: Container[str]) -> str:
    """Return an id of four characters that is not known yet."""
    while True:
        rest = (secrets.choice(ALPHABET) for _ in range(ID_LENGTH - 1))
        if (ident := secrets.choice(FIRST_LETTERS) + "".join(rest)) not in known:
            return ident


class Invitations:
    """The invitations of every study in a folder; a file is read again when it has changed."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._known: dict[str, tuple[object, dict[str, Invitation]]] = {}

    def of(self, name: str) -> dict[str, Invitation]:
        """Return a study's invitations by id, in the order of issuing; StudyError when the file is damaged."""
        path = self._path(name)
        stamp = stamp_of(path)
        known = self._known.get(name)
        if known is None or known[0] != stamp:
            try:
                rows = [] if stamp is None else read_object(path)["invitations"]
                if not isinstance(rows, list):
                    raise TypeError(f"invitations must be a list, got {type(rows).__name__}")
                by_id = {row["id"]: Invitation(**row) for row in rows}
                _ = [(each.issued_ms, each.revoked_ms) for each in by_id.values()]
            except (KeyError, TypeError, ValueError) as error:
                raise StudyError(f"{path} is damaged: {error!r}; restore a backup") from error
            known = self._known[name] = (stamp, by_id)
        return known[1]

    @contextmanager
    def _changing(self, name: str) -> Iterator[dict[str, Invitation]]:
        """Yield a study's invitations, to be changed, and write them."""
        with locked(self._folder.path(name)):
            found = dict(self.of(name))
            yield found
            told = [asdict(each) for each in found.values()]
            content = {"format": "humanplay-invitations-1", "invitations": told}
            write_object(self._path(name), content)

    def _path(self, name: str) -> Path:
        return self._folder.path(name) / "invitations.json"

    def issue(self, name: str, count: int, arm: str | None = None) -> list[Invitation]:
        """Issue new invitations to an open study and return them; StudyError when it takes none.

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
            known = ", ".join(arms) or "none"
            raise StudyError(f"the study {name!r} has no arm {arm!r}: there are {known}")
        with self._changing(name) as found:
            if not 1 <= count <= MAX_INVITATIONS - len(found):
                raise StudyError(
                    f"expected 1 to {counted(MAX_INVITATIONS - len(found), 'further invitation')} (a study has at most "
                    f"{MAX_INVITATIONS}), got {count}"
                )
            before, now = len(found), iso(now_ms())
            for _ in range(count):
                ident = new_id(found)
                found[ident] = Invitation(id=ident, issued_at=now, arm=arm)
        return list(found.values())[before:]

    def revoke(self, name: str, idents: Sequence[str]) -> list[Invitation]:
        """Revoke invitations by their ids and return them; StudyError for an unknown id, and then none is revoked.

        Whoever has agreed to the consent text with one goes on.
        """
        if not self._folder.study(name).is_running:
            raise StudyError(
                f"the study {name!r} is closed: its invitations let nobody in, and none is left to take back"
            )
        # a whole token begins with the id
        wanted = [read_code(ident)[:ID_LENGTH] for ident in idents]
        with self._changing(name) as found:
            pairs = zip(idents, wanted, strict=True)
            if unknown := [typed for typed, ident in pairs if ident not in found]:
                raise StudyError(
                    f"the study {name!r} has no invitation {unknown[0]!r}: `humanplay study invite {name} --list` shows all"
                )
            now = iso(now_ms())
            for ident in wanted:
                at = found[ident].revoked_at or now
                found[ident] = replace(found[ident], revoked_at=at)
        return [found[ident] for ident in wanted]

    def note_used(self, name: str, idents: Iterable[str]) -> None:
        """Unmark used invitations as revoked: revoking them had no effect."""
        with self._changing(name) as invitations:
            for ident in invitations.keys() & set(idents):
                invitations[ident] = replace(invitations[ident], revoked_at=None)

    def read_token(self, study: Study, token: str) -> Invitation | None:
        """Return the invitation, revoked or not, that a token was signed for; None for any other text."""
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

    state   `opened`: joined and not left again; `used`: agreed to the consent text
    label   of the participant
    at_ms   when
    """

    state: Literal["opened", "used"]
    label: str
    at_ms: int


def uses_of(reader: Reader, name: str) -> dict[str, Use]:
    """Return the use of each of a study's invitations with which somebody has come, by its id.

    Of several people who have opened one, the one who agreed is named, else the first who has not left again.
    """
    found: dict[str, Use] = {}
    for person in participants(reader, name):
        if person.invitation is None:
            continue
        if person.consent_ms is not None:
            found[person.invitation] = Use("used", participant_label(person.id), person.consent_ms)
        elif person.stage != "withdrawn":
            use = Use("opened", participant_label(person.id), person.joined_ms)
            found.setdefault(person.invitation, use)
    return found


def state_of(
    invitation: Invitation, use: Use | None
) -> Literal["issued", "opened", "used", "revoked"]:
    """Return an invitation's state; one that was used before it was revoked stays used."""
    if use is not None and use.state == "used":
        return "used"
    if invitation.revoked_ms is not None:
        return "revoked"
    return "issued" if use is None else use.state


def signature(secret: bytes, text: str, length: int) -> str:
    """Return `length` characters (5 bits each, at most 51 of them) of HMAC-SHA256(secret, text)."""
    number = int.from_bytes(hmac.new(secret, text.encode(), hashlib.sha256).digest(), "big")
    return "".join(ALPHABET[number >> (256 - 5 * (i + 1)) & 31] for i in range(length))


def grouped(code: str) -> str:
    """Return a code in groups of four, as it is shown."""
    return "-".join(code[i : i + 4] for i in range(0, len(code), 4))


def read_code(typed: str) -> str:
    """Return what was typed as a code: without spaces and dashes, in capitals, look-alikes read as what they look like."""
    return typed.upper().translate(_LOOK_ALIKES)


def _signed(study: Study, ident: str) -> str:
    text = f"{study.protocol_hash}|invitation|{ident}"
    return ident + signature(study.secret, text, _SIGNATURE_LENGTH)
