"""How people come into a study, for the operator: invitations and their states, the code for supervised sessions."""

from __future__ import annotations

from typing import Any

from app.storage.reader import Reader
from app.study.folder import Study
from app.study.invitations import Invitations, state_of, token_of, uses_of
from app.study.recruitment import code_of, valid_until_ms


def recruiting(
    reader: Reader, invitations: Invitations, study: Study, now_ms: int
) -> dict[str, Any]:
    """Return how people come into a study: its recruitment, the operator's code of the day, and its invitations.

    Invitations are in the order of issuing. The token of one that still lets somebody in is among them: the operator hands it
    out. A closed study has neither code nor tokens.
    """
    uses = uses_of(reader, study.name)
    listed = []
    for each in invitations.of(study.name).values():
        use = uses.get(each.id)
        state = state_of(each, use)
        lets_in = study.is_open and state in ("issued", "opened")
        listed.append(
            {
                "id": each.id,
                "state": state,
                "issued_ms": each.issued_ms,
                "revoked_ms": each.revoked_ms,
                "label": use and use.label,
                "at_ms": use and use.at_ms,
                "token": token_of(study, each.id) if lets_in else None,
            }
        )
    return {
        "recruitment": study.protocol.recruitment,
        "code": code_of(study, now_ms) if study.is_open else None,
        "code_until_ms": valid_until_ms(now_ms) if study.is_open else None,
        "invitations": listed,
    }
