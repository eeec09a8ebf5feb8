"""The manifest of a release: every file with its SHA-256, size and rows, the release's header, and a signature over it all."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from app.release import signing
from app.release.errors import ReleaseError
from app.release.header import RELEASE_FORMAT, ReleaseHeader
from app.storage.resimulation import Finding

MANIFEST, SIGNATURE, PUBLIC_KEY = "MANIFEST.json", "MANIFEST.sig", "PUBLIC_KEY.pem"
UNLISTED = {MANIFEST, SIGNATURE}


def write_manifest(folder: Path, header: ReleaseHeader, rows: Mapping[str, int], key: Any) -> str:
    """Write and sign the manifest of a release, and return its SHA-256 (hex).

    rows  by file, where a file has rows
    """
    (folder / PUBLIC_KEY).write_bytes(signing.public_pem(key))
    files = {
        name: {
            "sha256": sha256(folder / name),
            "bytes": (folder / name).stat().st_size,
            "rows": rows.get(name),
        }
        for name in listing(folder)
        if name not in UNLISTED
    }
    content = {
        **header.to_dict(),
        "signer": signing.fingerprint((folder / PUBLIC_KEY).read_bytes()),
        "files": files,
    }
    data = json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"
    (folder / MANIFEST).write_bytes(data)
    (folder / SIGNATURE).write_bytes(key.sign(data))
    return hashlib.sha256(data).hexdigest()


def read_manifest(folder: Path) -> tuple[dict[str, Any], str]:
    """Return a release's manifest and its SHA-256; ReleaseError when the folder holds no release."""
    try:
        data = (folder / MANIFEST).read_bytes()
        manifest = json.loads(data)
    except OSError as error:
        raise ReleaseError(
            f"{folder} is not a release: it has no {MANIFEST}; give the folder `release` wrote"
        ) from error
    except ValueError as error:
        raise ReleaseError(
            f"{folder / MANIFEST} is damaged: {error}; get the release again"
        ) from error
    if (
        not isinstance(manifest, dict)
        or manifest.get("format") != RELEASE_FORMAT
        or not isinstance(manifest.get("files"), dict)
    ):
        found = manifest.get("format") if isinstance(manifest, dict) else None
        raise ReleaseError(
            f"{folder / MANIFEST} has format {found!r}, this version reads {RELEASE_FORMAT!r}: update the software"
        )
    return manifest, hashlib.sha256(data).hexdigest()


def check_files(
    folder: Path, manifest: dict[str, Any], signer: str | None = None
) -> Iterator[Finding]:
    """Yield what differs between a release's files, manifest and signature.

    signer  fingerprint that the signing key must have; None takes the one in the release
    """
    try:
        pem = (folder / PUBLIC_KEY).read_bytes()
        signature = (folder / SIGNATURE).read_bytes()
    except OSError as error:
        yield Finding(
            f"file {Path(str(error.filename)).name}", "it", "missing", "a file of every release"
        )
        return
    found = signing.fingerprint(pem)
    if not signing.is_signed(pem, signature, (folder / MANIFEST).read_bytes()):
        yield Finding(
            f"file {MANIFEST}", "its signature", "invalid", f"a signature of the key {found}"
        )
    for expected in (manifest.get("signer"), signer):
        if expected is not None and expected != found:
            yield Finding(f"file {PUBLIC_KEY}", "the signing key", found, expected)
    present = set(listing(folder)) - UNLISTED
    for name in sorted(present - set(manifest["files"])):
        yield Finding(f"file {name}", "it", "there", "not in the manifest")
    for name, listed in manifest["files"].items():
        if name not in present:
            yield Finding(f"file {name}", "it", "missing", "in the manifest")
        elif (made := sha256(folder / name)) != listed["sha256"]:
            yield Finding(f"file {name}", "sha256", listed["sha256"], made)


def listing(folder: Path) -> list[str]:
    """Return the files below a folder by their path in it, in order."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )


def sha256(path: Path) -> str:
    """Return SHA-256 (hex) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
