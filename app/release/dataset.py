"""A released folder checked as a stranger would: files, signature, digests, and every episode simulated again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.release.header import DATABASE
from app.release.manifest import check_files, read_manifest
from app.release.verify import Advance, Verified, verify_database
from app.storage.database import StoreError
from app.storage.resimulation import Finding


@dataclass(frozen=True)
class Dataset:
    """A release that was checked: its manifest, that file's SHA-256, and what was found."""

    manifest: dict[str, Any]
    manifest_hash: str
    verified: Verified


def verify_dataset(folder: Path, advance: Advance = lambda done, total: None, signer: str | None = None) -> Dataset:
    """Return what the verification of a released folder came to; ReleaseError when it is not one.

    signer  fingerprint of the key that must have signed it
    """
    manifest, manifest_hash = read_manifest(folder)
    findings = list(check_files(folder, manifest, signer))
    try:
        verified = verify_database(folder / DATABASE, advance)
    except StoreError as error:
        findings.append(Finding(f"file {DATABASE}", "it", "unreadable", str(error)))
        verified = Verified(0, 0, 0, (), 0.0)
    return Dataset(manifest, manifest_hash, replace(verified, findings=(*findings, *verified.findings)))
