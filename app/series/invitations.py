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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.db.reader import Reader
from app.db.series import participants
from app.db.study_rows import participant_label
from app.series.files import iso, locked, ms_of, now_ms, read_object, stamp_of, write_object
from app.series.folder import Folder, Study
from app.series.protocol import StudyError

MAX_INVITATIONS = 5_000
"""Most invitations of a study."""

PARAMETER = "invitation"
"""The parameter of the link that holds the token."""

ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Crockford's base 32, of which codes consist: without I, L, O and U. A typed I or L is read as 1, an O as 0."""

_LOOK_ALIKES = str.maketrans("ILO", "110", " -_")
_FORMAT = "marsexplorer-invitations-1"
_ID_LENGTH, _SIGNATURE_LENGTH = 4, 12  # 60 bits that nobody can guess


@dataclass(frozen=True)
class Invitation:
    """An invitation; times are milliseconds since 1970, `revoked_ms` is None while it holds."""

    id: str
    issued_ms: int
    revoked_ms: int | None = None


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
            known = self._known[name] = (stamp, {} if stamp is None else _read(path))
        return known[1]

    def issue(self, name: str, count: int) -> list[Invitation]:
        """Issue new invitations to an open study and return them; StudyError when it takes none."""
        study = self._folder.study(name)
        if not study.is_running:
            raise StudyError(f"the study {name!r} is closed: nobody can be invited to it any more")
        if study.protocol.recruitment != "invitation":
            raise StudyError(
                f"the study {name!r} has recruitment {study.protocol.recruitment!r}: its link is /study/{name}, and only "
                "a study that was made with `--recruitment invitation` has invitations"
            )
        with locked(self._folder.path(name)):
            found = dict(self.of(name))
            if not 1 <= count <= MAX_INVITATIONS - len(found):
                raise StudyError(
                    f"expected 1 to {MAX_INVITATIONS - len(found)} further invitations (a study has at most "
                    f"{MAX_INVITATIONS}), got {count}"
                )
            issued: list[Invitation] = []
            now = now_ms()
            while len(issued) < count:
                ident = "".join(secrets.choice(ALPHABET) for _ in range(_ID_LENGTH))
                if ident not in found:
                    found[ident] = Invitation(ident, now)
                    issued.append(found[ident])
            self._write(name, found)
        return issued

    def revoke(self, name: str, idents: Sequence[str]) -> list[Invitation]:
        """Revoke invitations by their ids and return them; StudyError for an unknown id, and then none is revoked.

        Whoever has agreed to the consent text with one goes on.
        """
        self._folder.study(name)
        # a whole token begins with the id
        wanted = [read_code(ident)[:_ID_LENGTH] for ident in idents]
        with locked(self._folder.path(name)):
            found = dict(self.of(name))
            pairs = zip(idents, wanted, strict=True)
            unknown = [typed for typed, ident in pairs if ident not in found]
            if unknown:
                raise StudyError(
                    f"the study {name!r} has no invitation {unknown[0]!r}: `marsexplorer study invite {name} --list` shows all"
                )
            now = now_ms()
            for ident in wanted:
                if found[ident].revoked_ms is None:
                    found[ident] = Invitation(ident, found[ident].issued_ms, now)
            self._write(name, found)
        return [found[ident] for ident in wanted]

    def read_token(self, study: Study, token: str) -> Invitation | None:
        """Return the invitation, revoked or not, that a token was signed for; None for any other text."""
        typed = read_code(token)
        ident = typed[:_ID_LENGTH]
        if not hmac.compare_digest(typed.encode(), _signed(study, ident).encode()):
            return None
        return self.of(study.name).get(ident)

    def _path(self, name: str) -> Path:
        return self._folder.path(name) / "invitations.json"

    def _write(self, name: str, found: dict[str, Invitation]) -> None:
        listed = [
            {
                "id": each.id,
                "issued_at": iso(each.issued_ms),
                "revoked_at": each.revoked_ms and iso(each.revoked_ms),
            }
            for each in found.values()
        ]
        write_object(self._path(name), {"format": _FORMAT, "invitations": listed})


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


def _read(path: Path) -> dict[str, Invitation]:
    raw = read_object(path)
    try:
        rows = [(row["id"], row["issued_at"], row["revoked_at"]) for row in raw["invitations"]]
        return {
            ident: Invitation(ident, ms_of(issued), ms_of(revoked) if revoked else None)
            for ident, issued, revoked in rows
        }
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{path} is damaged: {error!r}; restore it from a backup") from error
