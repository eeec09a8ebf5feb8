"""The header of a release: the one source of its manifest, datasheet, citation and Croissant metadata."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from app.study.flow import Arrivals
from app.study.protocol import Protocol

RELEASE_FORMAT = "marsexplorer-release-1"
BUNDLE_DATABASE = "study.sqlite"


@dataclass(frozen=True)
class ReleaseHeader:
    """A release.

    version     1, 2, ... of this study's releases
    released    ISO 8601, UTC
    secret      hex
    supersedes  {"version", "manifest_sha256", "reason"} of the release it stands in for, or None
    rows        rows by table
    left_out    what the release does not hold, counted
    chain_head  hex: head of the chain (of `chain_entries`) of the database it was made from; None without an entry
    arrivals    people who are not in it, and invitations
    attestation ranked episodes of people by level; "" stands for those that have none
    withdrawn   people who agreed and withdrew later
    frozen_at, first_came_at  ISO 8601, UTC: when the protocol was frozen, and when the first participant came ("" for nobody)
    regret_policy_hash  SHA-256 of the policy that the regrets are relative to; "" without regrets
    without_policies  of the protocol, which the report leaves out because their files were not at hand
    """

    study: str
    protocol: Protocol
    protocol_hash: str
    commitment: str
    secret: str
    version: int
    released: str
    software_version: str
    supersedes: dict[str, Any] | None
    authors: tuple[str, ...]
    url: str | None
    rows: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    outcomes: dict[str, int] = field(default_factory=dict)
    chain_head: str | None = None
    chain_entries: int = 0
    without_policies: tuple[str, ...] = ()
    regret_policy_hash: str = ""
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
        """Return what the dataset is, in a few sentences."""
        config = self.protocol.env_config
        counted = ", ".join(
            f"{self.rows.get(name, 0)} {words}" for name, words in _COUNTED_IN_SUMMARY
        )
        where = f"level {config.level} at {config.rows}x{config.cols}"
        return (
            f"Recordings of the MarsExplorer study {self.study}: {counted}, on {where}. Every participant met the same "
            f"{self.protocol.ranked} ranked terrains. Each episode replays exactly from its cause."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the header as the manifest holds it."""
        return {
            "format": RELEASE_FORMAT,
            "study": self.study,
            "title": self.title,
            "version": self.version,
            "released": self.released,
            "software_version": self.software_version,
            "core_version": self.protocol.core_version,
            "protocol_hash": self.protocol_hash,
            "commitment": self.commitment,
            "secret": self.secret,
            "data_licence": self.protocol.data_licence,
            "authors": list(self.authors),
            "supersedes": self.supersedes,
            "rows": self.rows,
            "left_out": self.left_out,
            "chain_head": self.chain_head,
            "chain_entries": self.chain_entries,
            "without_policies": list(self.without_policies),
            "regret_policy_hash": self.regret_policy_hash or None,
            "arrivals": asdict(self.arrivals),
        }


_COUNTED_IN_SUMMARY = (
    ("participants", "participants"),
    ("episodes", "episodes"),
    ("steps", "moves"),
    ("input_events", "input events"),
)
