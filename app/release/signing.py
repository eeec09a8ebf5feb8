"""Ed25519 signatures: a key next to the database, its public half in every release.

A valid signature proves that the holder of this key wrote exactly these files. That the key is a certain group's has to be
learnt elsewhere: they publish its fingerprint, in their paper say.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from app.release.errors import ReleaseError, library


def key_path(database: Path) -> Path:
    """Return where a database's signing key lies."""
    return database.with_name(database.name + "-signing-key")


def signing_key(database: Path) -> Any:
    """Return the Ed25519 key next to a database, made on first use and readable by its owner alone."""
    serialization, ed25519 = _libraries()
    path = key_path(database)
    if not path.exists():
        drawn = ed25519.Ed25519PrivateKey.generate().private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        try:
            with os.fdopen(
                os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb"
            ) as file:
                file.write(drawn)
        except FileExistsError:
            pass  # another release drew it a moment ago
        except OSError as error:
            raise ReleaseError(
                f"cannot write the signing key {path}: {(error.strerror or str(error)).lower()}"
            ) from error
    try:
        return serialization.load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise ReleaseError(
            f"cannot read the signing key {path}: {error}; restore it, or move it away to have a new one drawn"
        ) from error


def public_pem(key: Any) -> bytes:
    """Return the public half as PEM, for the release."""
    serialization, _ = _libraries()
    pem: bytes = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    return pem


def fingerprint(pem: bytes) -> str:
    """Return SHA-256 (hex) of a public key's raw 32 bytes; ReleaseError when it is no Ed25519 key."""
    serialization, _ = _libraries()
    raw = _public(pem).public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return hashlib.sha256(raw).hexdigest()


def is_signed(pem: bytes, signature: bytes, message: bytes) -> bool:
    """Return whether the signature over the message is this key's."""
    from cryptography.exceptions import InvalidSignature

    try:
        _public(pem).verify(signature, message)
    except InvalidSignature:
        return False
    return True


def _public(pem: bytes) -> Any:
    serialization, ed25519 = _libraries()
    try:
        key = serialization.load_pem_public_key(pem)
    except ValueError as error:
        raise ReleaseError("PUBLIC_KEY.pem is not a public key: get the release again") from error
    if not isinstance(key, ed25519.Ed25519PublicKey):
        raise ReleaseError("PUBLIC_KEY.pem is not an Ed25519 key: get the release again")
    return key


def _libraries() -> tuple[Any, Any]:
    where = "cryptography.hazmat.primitives"
    return library(f"{where}.serialization"), library(f"{where}.asymmetric.ed25519")
