"""The header of a release, and its manifest.

The documents are made from the header. The manifest has the header, every file with its SHA-256,
size and rows, and a signature over it all.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from humanplay.db.resimulation import Finding
from humanplay.release import signing
from humanplay.release.errors import ReleaseError
from humanplay.release.signing import Manifest
from humanplay.study.flow import Arrivals
from humanplay.study.protocol import Protocol
from humanplay.task import counted

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

RELEASE_FORMAT = "humanplay-release-1"
BUNDLE_DATABASE = "study.sqlite"
MANIFEST, SIGNATURE, PUBLIC_KEY = "MANIFEST.json", "MANIFEST.sig", "PUBLIC_KEY.pem"
UNLISTED = {MANIFEST, SIGNATURE}
COUNTED_TABLES = {
    "participants": "participant",
    "episodes": "episode",
    "steps": "move",
    "input_events": "input event",
    "stage_events": "stage event",
}


class SupersededRelease(TypedDict):
    """An earlier release, and why another one stands in for it."""

    version: int
    manifest_sha256: str
    reason: str


@dataclass(frozen=True)
class ReleaseHeader:
    """A release.

    version           1, 2, ... of this study's releases
    released          ISO 8601, UTC
    secret            hex
    supersedes        the release it stands in for
    rows              rows by table
    left_out          what the release does not hold, counted
    chain_head        hex: head of the chain (of `chain_entries`) of the database it was made
                      from; None without an entry
    arrivals          people who are not in it, and invitations
    attestation       ranked episodes of people by level; "" stands for those that have none
    withdrawn         people who agreed and withdrew later
    frozen_at         ISO 8601, UTC: when the protocol was frozen
    first_came_at     when the first participant came; "" for nobody
    expert_hash       SHA-256 of the policy that moves are judged by; "" without costs
    without_policies  of the protocol, which the report leaves out because their files were not
                      at hand
    """

    study: str
    protocol: Protocol
    protocol_hash: str
    commitment: str
    secret: str
    version: int
    released: str
    software_version: str
    supersedes: SupersededRelease | None
    authors: tuple[str, ...]
    url: str | None
    rows: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    outcomes: dict[str, int] = field(default_factory=dict)
    chain_head: str | None = None
    chain_entries: int = 0
    without_policies: tuple[str, ...] = ()
    expert_hash: str = ""
    arrivals: Arrivals = field(default_factory=Arrivals)
    attestation: dict[str, int] = field(default_factory=dict)
    withdrawn: int = 0
    frozen_at: str = ""
    first_came_at: str = ""

    @property
    def title(self) -> str:
        """The dataset's title."""
        return f"{self.protocol.title}: every episode"

    def summary(self) -> str:
        """What the dataset is, in a few sentences."""
        config = self.protocol.env_config
        recorded = ", ".join(
            counted(self.rows.get(table, 0), words) for table, words in COUNTED_TABLES.items()
        )
        environment = self.protocol.environment
        texts = environment.texts(config)
        ranked = counted(self.protocol.ranked, "ranked instance")
        return (
            f"Recordings of the {environment.about.title} study {self.study}: {recorded}, on {texts.setting}. "
            f"Every participant met the same {ranked}. Each episode replays exactly from its cause."
            f"{texts.observations and f' {texts.observations}'}"
        )

    def to_dict(self) -> dict[str, object]:
        """The header as the manifest holds it."""
        names = (
            *("study", "title", "version", "released", "software_version", "core_version"),
            *("protocol_hash", "commitment", "secret", "data_licence", "authors", "supersedes"),
            *("rows", "left_out", "chain_head", "chain_entries", "without_policies"),
        )
        protocol = self.protocol
        of_protocol = {"core_version": protocol.core_version, "data_licence": protocol.data_licence}
        return {
            "format": RELEASE_FORMAT,
            **{
                name: of_protocol[name] if name in of_protocol else getattr(self, name)
                for name in names
            },
            "expert_hash": self.expert_hash or None,
            "arrivals": asdict(self.arrivals),
        }


def write_manifest(
    folder: Path, header: ReleaseHeader, rows: Mapping[str, int], key: Ed25519PrivateKey
) -> str:
    """Write and sign the manifest of a release, and return its SHA-256 (hex).

    Args:
        rows: By file, where a file has rows.
    """
    (folder / PUBLIC_KEY).write_bytes(signing.public_pem(key))
    files = {}
    for name in (name for name in listing(folder) if name not in UNLISTED):
        size, digest = (folder / name).stat().st_size, sha256(folder / name)
        files[name] = {"sha256": digest, "bytes": size, "rows": rows.get(name)}
    signer = signing.fingerprint((folder / PUBLIC_KEY).read_bytes())
    content = {**header.to_dict(), "signer": signer, "files": files}
    text = json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"
    (folder / MANIFEST).write_bytes(text)
    (folder / SIGNATURE).write_bytes(key.sign(text))
    return hashlib.sha256(text).hexdigest()


def read_manifest(folder: Path) -> tuple[Manifest, str]:
    """A release's manifest and its SHA-256 (hex).

    Raises:
        ReleaseError: If the folder holds no release.
    """
    try:
        text = (folder / MANIFEST).read_bytes()
        manifest = json.loads(text)
    except OSError as error:
        raise ReleaseError(
            f"{folder} is not a release: it has no {MANIFEST}; give the folder `release` wrote"
        ) from error
    except ValueError as error:
        raise ReleaseError(
            f"{folder / MANIFEST} is damaged: {error}; get the release again"
        ) from error
    form = manifest.get("format") if isinstance(manifest, dict) else None
    if form != RELEASE_FORMAT or not isinstance(manifest.get("files"), dict):
        raise ReleaseError(
            f"{folder / MANIFEST} has format {form!r}, this version reads {RELEASE_FORMAT!r}: update the software"
        )
    return manifest, hashlib.sha256(text).hexdigest()


def check_files(folder: Path, manifest: Manifest, signer: str | None = None) -> Iterator[Finding]:
    """Yield what differs between a release's files, manifest and signature.

    Args:
        signer: Fingerprint that the signing key must have; None takes the one in the release.
    """
    try:
        pem = (folder / PUBLIC_KEY).read_bytes()
        signature = (folder / SIGNATURE).read_bytes()
    except OSError as error:
        name = Path(str(error.filename)).name
        yield Finding(f"file {name}", "it", "missing", "a file of every release")
        return
    signed_by = signing.fingerprint(pem)
    if not signing.is_signed(pem, signature, (folder / MANIFEST).read_bytes()):
        key = f"a signature of the key {signed_by}"
        yield Finding(f"file {MANIFEST}", "its signature", "invalid", key)
    for expected in (manifest.get("signer"), signer):
        if expected is not None and expected != signed_by:
            yield Finding(f"file {PUBLIC_KEY}", "the signing key", signed_by, expected)
    present = set(listing(folder)) - UNLISTED
    for name in sorted(present - set(manifest["files"])):
        yield Finding(f"file {name}", "it", "there", "not in the manifest")
    for name, listed in manifest["files"].items():
        if name not in present:
            yield Finding(f"file {name}", "it", "missing", "in the manifest")
        elif (digest := sha256(folder / name)) != listed["sha256"]:
            yield Finding(f"file {name}", "sha256", listed["sha256"], digest)


def listing(folder: Path) -> list[str]:
    """The files below a folder by their path in it, in order."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return sorted(path.relative_to(folder).as_posix() for path in files)


def sha256(path: Path) -> str:
    """SHA-256 (hex) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
