"""A released folder: verified as a stranger would verify it, and imported into a database.

The verification checks the files, the signature and the chain, and simulates every episode again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from app.database_file.file import DatabaseLock
from app.release.errors import ReleaseError
from app.release.header import BUNDLE_DATABASE
from app.release.manifest import check_files, read_manifest
from app.storage.database import StoreError, reading, transaction
from app.storage.erasure import learn_counts
from app.storage.merging import MergeCounts, kept_or_new_database, merge_rows
from app.storage.releases import ReleaseRow, note_imported_release
from app.storage.resimulation import Finding
from app.study.folder import Advance
from app.study.verification import Verification, verify_database


@dataclass(frozen=True)
class VerifiedBundle:
    """A release that was checked: its manifest, that file's SHA-256, and what was found."""

    manifest: dict[str, Any]
    manifest_hash: str
    verified: Verification


def verify_bundle(
    folder: Path, advance: Advance = lambda done, total: None, signer: str | None = None
) -> VerifiedBundle:
    """Verify a released folder; ReleaseError when it is not one.

    advance  called with (episodes simulated, of how many)
    signer   fingerprint of the key that must have signed it
    """
    manifest, manifest_hash = read_manifest(folder)
    findings = list(check_files(folder, manifest, signer))
    try:
        verified = verify_database(folder / BUNDLE_DATABASE, advance)
    except StoreError as error:
        findings.append(Finding(f"file {BUNDLE_DATABASE}", "it", "unreadable", str(error)))
        verified = Verification(0, 0, 0, (), 0.0)
    return VerifiedBundle(
        manifest, manifest_hash, replace(verified, findings=(*findings, *verified.findings))
    )


def import_release(
    folder: Path,
    database: Path,
    advance: Advance = lambda done, total: None,
    signer: str | None = None,
) -> MergeCounts:
    """Import a release into a database, which is made when absent, and return what was added.

    advance  called with (episodes verified, of how many)
    signer   fingerprint of the key that must have signed it

    ReleaseError when the release does not verify; MergeError when the database holds its episodes under other names;
    StoreError while a server has the database. Nothing is changed then.
    """
    checked = verify_bundle(folder, advance, signer)
    if checked.verified.findings:
        more = len(checked.verified.findings) - 1
        also = f" and {more} more" if more else ""
        raise ReleaseError(
            f"no import: {checked.verified.findings[0]}{also}; `marsexplorer verify --dataset {folder}` lists all"
        )
    manifest = checked.manifest
    released_ms = int(datetime.fromisoformat(manifest["released"]).timestamp() * 1000)
    lock = DatabaseLock(database)
    try:
        with (
            kept_or_new_database(database) as conn,
            reading(folder / BUNDLE_DATABASE) as source,
            transaction(conn),
        ):
            counts = merge_rows(conn, source, str(folder))
            learn_counts(conn, source)
            release = ReleaseRow(
                manifest["study"], manifest["version"], checked.manifest_hash, released_ms
            )
            note_imported_release(conn, release)
        return counts
    finally:
        lock.close()
        if not database.exists():
            database.with_name(database.name + "-lock").unlink(missing_ok=True)
