"""A released folder: opened, verified as a stranger would, and imported.

The verification checks the files, the signature and the chain, and simulates every episode again.
"""

from __future__ import annotations

import string
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Self

from humanplay.db.database import StoreError, check_writable, reading, transaction
from humanplay.db.erasure import learn_counts
from humanplay.db.file import DatabaseLock
from humanplay.db.merging import MergeCounts, kept_or_new_database, merge_rows
from humanplay.db.reader import Reader
from humanplay.db.releases import ReleaseRow, note_imported_release
from humanplay.db.resimulation import Finding
from humanplay.release.errors import ReleaseError
from humanplay.release.manifest import BUNDLE_DATABASE, check_files, read_manifest
from humanplay.release.signing import Manifest
from humanplay.report.costs import CostRow
from humanplay.study.data import load
from humanplay.study.folder import Advance
from humanplay.study.policy_episodes import PolicyEpisode
from humanplay.study.policy_files import FOLDER
from humanplay.study.verification import Verification, verify_database
from humanplay.task import Environment


def initials(environment: Environment) -> str:
    """What stands for each action in the moves of policies: its initial.

    If two actions share one, all are called by signs in the order of their codes.
    """
    letters = "".join(name[0].upper() for name in environment.actions)
    signs = string.digits + string.ascii_letters + "-_"
    return letters if len(set(letters)) == len(letters) else signs[: len(letters)]


class Bundle:
    """A released folder, opened once; use it in a `with` block.

    Attributes:
        manifest: The parsed manifest.
        manifest_hash: SHA-256 (hex) of its file.
        reader: Reads the folder's database.
        data: The study, with the files of the policies that are in the bundle.

    Raises:
        ReleaseError: If the folder holds no release.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest, self.manifest_hash = read_manifest(folder)
        self.reader = Reader.open(folder / BUNDLE_DATABASE)
        try:
            data = load(self.reader, str(self.manifest["study"]))
            self.policy_episodes = self._policy_episodes(initials(data.protocol.environment))
        except BaseException:
            self.reader.close()
            raise
        played = {episode.policy: episode.policy_hash for episode in self.policy_episodes}
        recorded = dict(played)
        if (expert := data.protocol.environment.expert) is not None:
            recorded[expert] = self.expert_hash
        with_digest = {name: digest for name, digest in recorded.items() if digest}
        hashes = {**data.policy_files.hashes, **with_digest}
        files = replace(data.policy_files, hashes=hashes, folder=folder / FOLDER)
        self.data = replace(data, policy_files=files)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.reader.close()

    @property
    def expert_hash(self) -> str | None:
        """SHA-256 (hex) of the policy that its moves are judged by; None without costs."""
        return self.manifest.get("expert_hash")

    def _policy_episodes(self, letters: str) -> tuple[PolicyEpisode, ...]:
        rows = self.reader.query("SELECT * FROM policy_episodes ORDER BY place, terrain_index")
        return tuple(
            PolicyEpisode(
                policy=row["policy"],
                policy_hash=row["policy_hash"],
                terrain=row["terrain_index"],
                seed=row["seed"],
                actions=bytes(letters.index(letter) for letter in row["actions"]),
                trajectory_hash=row["trajectory_hash"],
            )
            for row in rows
        )

    def costs(self) -> tuple[CostRow, ...]:
        """The recorded costs of moves, by episode and move."""
        rows = self.reader.query("SELECT * FROM move_costs ORDER BY episode_id, step")
        return tuple(CostRow(episode=row.pop("episode_id"), **row) for row in rows)


@dataclass(frozen=True)
class VerifiedBundle:
    """A release that was checked.

    Attributes:
        manifest_hash: SHA-256 (hex) of the manifest's file.
        verified: What was checked, and the findings.
    """

    manifest: Manifest
    manifest_hash: str
    verified: Verification


def verify_bundle(
    folder: Path, advance: Advance = lambda done, total: None, signer: str | None = None
) -> VerifiedBundle:
    """Verify a released folder.

    Args:
        advance: Called with (episodes simulated, how many in all).
        signer: Fingerprint of the key that must have signed it.

    Raises:
        ReleaseError: If the folder holds no release.
    """
    manifest, manifest_hash = read_manifest(folder)
    findings = list(check_files(folder, manifest, signer))
    try:
        verified = verify_database(folder / BUNDLE_DATABASE, advance)
    except StoreError as error:
        findings.append(Finding(f"file {BUNDLE_DATABASE}", "it", "unreadable", str(error)))
        verified = Verification(0, 0, 0, (), 0.0)
    verified = replace(verified, findings=(*findings, *verified.findings))
    return VerifiedBundle(manifest, manifest_hash, verified)


def import_release(
    folder: Path,
    database: Path,
    advance: Advance = lambda done, total: None,
    signer: str | None = None,
) -> MergeCounts:
    """Import a release into a database, which is created if it is absent.

    Args:
        advance: Called with (episodes verified, how many in all).
        signer: Fingerprint of the key that must have signed it.

    Returns:
        What was added.

    Raises:
        ReleaseError: If the release does not verify.
        MergeError: If the database holds its episodes under other names.
        StoreError: If a server has the database. Nothing is changed in all three cases.
    """
    check_writable(database)
    checked = verify_bundle(folder, advance, signer)
    if checked.verified.findings:
        first, *others = checked.verified.findings
        also = f" and {len(others)} more" if others else ""
        raise ReleaseError(
            f"no import: {first}{also}; `humanplay verify --dataset {folder}` lists all"
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
            about = manifest["study"], manifest["version"], checked.manifest_hash, released_ms
            note_imported_release(conn, ReleaseRow(*about))
        return counts
    finally:
        lock.close()
        if not database.exists():
            database.with_name(database.name + "-lock").unlink(missing_ok=True)
