"""Whose signature a bundle carries, as far as that is known here: a key that was given, a pinned one, or an unknown one.

A valid signature proves only that the holder of some key wrote the files. Whose key it is has to be learnt elsewhere, from a
paper say; a fingerprint that was checked once can be pinned, so that the next bundle of the same group is known.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from app.release import signing
from app.release.errors import ReleaseError
from marsexplorer.files import write_whole

SIGNERS_FORMAT = "marsexplorer-signers-1"


@dataclass(frozen=True)
class SignerCheck:
    """What is known of a bundle's signer.

    fingerprint  of the key that signed it, SHA-256 (hex)
    known_by     `key`: the one that was asked for; `pin`: a pinned one; None: the signer was not checked
    other        fingerprint of another key that is pinned for the same study, if there is one
    """

    fingerprint: str
    known_by: Literal["key", "pin"] | None
    other: str | None = None

    def sentence(self) -> str:
        """Return what is known, in words."""
        if self.known_by == "key":
            return f"signer checked: {self.fingerprint} is the key that was given"
        if self.known_by == "pin":
            return f"signer checked: {self.fingerprint} is a pinned key"
        changed = (
            f", and it is not {self.other}, the key that is pinned for this study"
            if self.other
            else ""
        )
        return (
            f"signer not checked: nothing here says whose key {self.fingerprint} is{changed}; "
            "give the fingerprint that its owners published with --key"
        )


def fingerprint_of(given: str) -> str:
    """Return the fingerprint (hex) of a key: given as one, or as the file of a public key; ReleaseError for neither."""
    path = Path(given)
    if path.is_file():
        return signing.fingerprint(path.read_bytes())
    if re.fullmatch(r"[0-9a-fA-F]+", given):
        return given.lower()
    raise ReleaseError(
        f"--key takes a fingerprint (64 hexadecimal digits) or the file of a public key, got {given!r}"
    )


def check_signer(manifest: Mapping[str, Any], key: str | None, pins: Path) -> SignerCheck:
    """Return what is known of the signer whom a manifest names; whether the signature is valid is `check_files`' to say.

    key   the fingerprint that was asked for, which `check_files` compares; None: only the pinned keys are looked at
    pins  the file of pinned keys; it need not exist
    """
    found = str(manifest.get("signer"))
    pinned = read_pins(pins)
    others = [
        name
        for name, about in pinned.items()
        if about.get("protocol_hash") == manifest.get("protocol_hash")
    ]
    other = next((name for name in others if name != found), None)
    if key is not None:
        return SignerCheck(found, "key" if key == found else None, other)
    return SignerCheck(found, "pin" if found in pinned else None, other)


def pin(pins: Path, manifest: Mapping[str, Any]) -> None:
    """Add the signer of a manifest to the file of pinned keys."""
    about = {name: manifest.get(name) for name in ("study", "authors", "protocol_hash")}
    about["pinned"] = datetime.now(UTC).isoformat(timespec="seconds")
    signers = {**read_pins(pins), str(manifest["signer"]): about}
    pins.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(pins) as file:
        file.write(
            json.dumps(
                {"format": SIGNERS_FORMAT, "signers": signers}, indent=2, ensure_ascii=False
            ).encode()
            + b"\n"
        )


def read_pins(pins: Path) -> dict[str, dict[str, Any]]:
    """Return fingerprint -> what was noted when it was pinned; ReleaseError for a file that is none of pinned keys."""
    if not pins.exists():
        return {}
    try:
        content = json.loads(pins.read_bytes())
        if content["format"] != SIGNERS_FORMAT:
            raise ValueError(f"format {content['format']!r}")
        return dict(content["signers"])
    except (ValueError, KeyError, TypeError) as error:
        raise ReleaseError(
            f"{pins} is no file of pinned keys ({error}): correct it, or move it away"
        ) from error
