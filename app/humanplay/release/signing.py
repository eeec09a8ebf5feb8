"""Ed25519 signatures of releases, and whose they are as far as that is known here.

The key lies next to the database, its public half in every release. A valid signature proves that
the holder of this key wrote exactly these files. That the key is a certain group's has to be learnt
elsewhere, from their paper say; a fingerprint that was checked once can be pinned, so that the next
bundle of the same group is known.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Literal, TypedDict

from humanplay.release.errors import ReleaseError, library
from marsexplorer.files import write_whole

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )

SIGNERS_FORMAT = "humanplay-signers-1"


class ListedFile(TypedDict):
    """A file of a release as its manifest lists it; `rows` of a table alone."""

    sha256: str
    bytes: int
    rows: int | None


class Manifest(TypedDict):
    """What a release's signature stands for: its header, and every file.

    authors     named in the citation
    expert_hash SHA-256 (hex) of the policy that moves are judged by; None without costs
    signer      fingerprint of the key
    """

    study: str
    version: int
    released: str
    software_version: str
    protocol_hash: str
    authors: list[str]
    expert_hash: str | None
    signer: str
    files: dict[str, ListedFile]


def key_path(database: Path) -> Path:
    """The file of a database's signing key."""
    return database.with_name(database.name + "-signing-key")


def signing_key(database: Path) -> Ed25519PrivateKey:
    """The Ed25519 key next to a database, made on first use, only its owner's."""
    serialization, ed25519 = _libraries()
    path = key_path(database)
    if not path.exists():
        form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
        key = ed25519.Ed25519PrivateKey.generate()
        pem = key.private_bytes(*form, serialization.NoEncryption())
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(handle, "wb") as file:
                file.write(pem)
        except FileExistsError:
            pass  # another release drew it a moment ago
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ReleaseError(f"cannot write the signing key {path}: {reason}") from error
    try:
        stored: Ed25519PrivateKey = serialization.load_pem_private_key(path.read_bytes(), None)
        return stored
    except (OSError, ValueError, TypeError) as error:
        raise ReleaseError(
            f"cannot read the signing key {path}: {error}; restore it, or move it away to have a new one drawn"
        ) from error


def public_pem(key: Ed25519PrivateKey) -> bytes:
    """The public half as PEM, for the release."""
    serialization, _ = _libraries()
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    return key.public_key().public_bytes(serialization.Encoding.PEM, form)


def fingerprint(pem: bytes) -> str:
    """SHA-256 (hex) of a public key's raw 32 bytes.

    Raises:
        ReleaseError: If it is no Ed25519 key.
    """
    serialization, _ = _libraries()
    raw = _public(pem).public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return hashlib.sha256(raw).hexdigest()


def is_signed(pem: bytes, signature: bytes, message: bytes) -> bool:
    """Whether the signature over the message is this key's."""
    from cryptography.exceptions import InvalidSignature

    try:
        _public(pem).verify(signature, message)
    except InvalidSignature:
        return False
    return True


def _public(pem: bytes) -> Ed25519PublicKey:
    serialization, ed25519 = _libraries()
    try:
        key = serialization.load_pem_public_key(pem)
    except ValueError as error:
        raise ReleaseError("PUBLIC_KEY.pem is not a public key: get the release again") from error
    if not isinstance(key, ed25519.Ed25519PublicKey):
        raise ReleaseError("PUBLIC_KEY.pem is not an Ed25519 key: get the release again")
    public: Ed25519PublicKey = key
    return public


def _libraries() -> tuple[ModuleType, ModuleType]:
    package = "cryptography.hazmat.primitives"
    return library(f"{package}.serialization"), library(f"{package}.asymmetric.ed25519")


@dataclass(frozen=True)
class SignerCheck:
    """What is known of a bundle's signer.

    Attributes:
        fingerprint: Of the key that signed it, SHA-256 (hex).
        known_by: `key`: the one that was asked for; `pin`: a pinned one; None: the signer was
            not checked.
        other: Fingerprint of another key that is pinned for the same study, if there is one.
    """

    fingerprint: str
    known_by: Literal["key", "pin"] | None
    other: str | None = None

    def sentence(self) -> str:
        """What is known of the signer, in words."""
        if self.known_by == "key":
            return f"signer checked: {self.fingerprint} is the key that was given"
        if self.known_by == "pin":
            return f"signer checked: {self.fingerprint} is a pinned key"
        changed = ""
        if self.other:
            changed = f", and it is not {self.other}, the key that is pinned for this study"
        return (
            f"signer not checked: nothing here says whose key {self.fingerprint} is{changed}; "
            "give the fingerprint that its owners published with --key"
        )


def fingerprint_of(key: str) -> str:
    """The fingerprint (hex) of a key.

    Args:
        key: A fingerprint, or the file of a public key.

    Raises:
        ReleaseError: If it is neither.
    """
    path = Path(key)
    if path.is_file():
        return fingerprint(path.read_bytes())
    if re.fullmatch(r"[0-9a-fA-F]+", key):
        return key.lower()
    raise ReleaseError(
        f"--key takes a fingerprint (64 hexadecimal digits) or the file of a public key, got {key!r}"
    )


def check_signer(manifest: Manifest, key: str | None, pins: Path) -> SignerCheck:
    """What is known of the signer whom a manifest names.

    Whether the signature is valid is for `check_files` to say.

    Args:
        key: The fingerprint that was asked for, which `check_files` compares; None: only the pinned
            keys are looked at.
        pins: The file of pinned keys; it need not exist.
    """
    signer = str(manifest.get("signer"))
    pinned = read_pins(pins)
    study = manifest.get("protocol_hash")
    others = [name for name, about in pinned.items() if about.get("protocol_hash") == study]
    other = next((name for name in others if name != signer), None)
    if key is not None:
        return SignerCheck(signer, "key" if key == signer else None, other)
    return SignerCheck(signer, "pin" if signer in pinned else None, other)


def pin(pins: Path, manifest: Manifest) -> None:
    """Add the signer of a manifest to the file of pinned keys."""
    about = {
        "study": manifest.get("study"),
        "authors": manifest.get("authors"),
        "protocol_hash": manifest.get("protocol_hash"),
        "pinned": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    signers = {**read_pins(pins), str(manifest["signer"]): about}
    content = {"format": SIGNERS_FORMAT, "signers": signers}
    pins.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(pins) as file:
        file.write(json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n")


def read_pins(pins: Path) -> dict[str, dict[str, object]]:
    """Fingerprint -> what was noted when it was pinned.

    Raises:
        ReleaseError: If the file is none of pinned keys.
    """
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
