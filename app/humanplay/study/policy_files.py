"""The files of a study's policies, copied and recorded by SHA-256 at freezing.

    NAME/policies/SHA256.onnx   in the folder of studies; a release has such a folder too

A name may stand for another file in a later version, and a path for another one or for none. So whatever plays a policy of a
frozen study asks here for the file of the recorded hash, and no other file takes its place.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from humanplay.study.files import write_bytes
from humanplay.study.protocol import Protocol, StudyError
from humanplay.task import Policies, PolicyError
from humanplay.task.registration import DEFAULT_TASK, environment_of

FOLDER = "policies"
"""The folder of the kept files, in a study's folder and in a release."""


@dataclass(frozen=True)
class PolicyFiles:
    """The files of a study's policies.

    hashes  SHA-256 (hex) by policy, as the protocol names it; a rule has none, and where none was recorded, today's file plays
    folder  where the files are kept; None where that is not at hand
    task    whose policies they are
    """

    hashes: Mapping[str, str] = field(default_factory=dict)
    folder: Path | None = None
    task: str = DEFAULT_TASK

    @classmethod
    def of(cls, protocol: Protocol, folder: Path | None = None) -> PolicyFiles:
        """Return the files that a frozen protocol means."""
        return cls(protocol.policy_hashes, folder, protocol.task)

    def at(self, folder: Path) -> PolicyFiles:
        """Return the same with the files kept in this folder."""
        return replace(self, folder=folder)

    def source(self, policy: str) -> str:
        """What `Policies.load` takes for a policy: its name, or the path of its file.

        Raises:
            PolicyError: If no file with the recorded hash is there.
        """
        expected = self.hashes.get(policy)
        if expected is None or self._hash_of(policy) == expected:
            return policy
        for path in (*self._kept(expected), self._policies.find_shipped(expected)):
            if path is not None and self._hash_of(str(path)) == expected:
                return str(path)
        raise PolicyError(
            f"the study compares with the policy {policy!r} of SHA-256 {expected}, and that file is not here; no other one is "
            f"played in its place. Copy it from the study's folder or from a release to {self.place(policy)}"
        )

    def expert(self, name: str) -> str:
        """The file that judges the study's moves (`Environment.expert`).

        PolicyError if none was recorded when the study was frozen, and as `source`.
        """
        if self._policies.is_rule(name):
            return name
        if name not in self.hashes:
            raise PolicyError(
                f"no file of {name} was kept when the study was frozen, so none of its moves is judged"
            )
        return self.source(name)

    def place(self, policy: str) -> Path:
        """Return where the file of a policy with a recorded hash is kept, or would be."""
        copy = next(self._kept(self.hashes[policy]), None)
        name = f"{self.hashes[policy]}{Path(policy).suffix or '.onnx'}"
        return copy or (self.folder or Path(FOLDER)) / name

    def copy_to(self, folder: Path, policies: Iterable[str]) -> None:
        """Copy the files of some policies with a recorded hash into a folder.

        Raises:
            PolicyError, StudyError: As for `source`.
        """
        for policy in (policy for policy in dict.fromkeys(policies) if policy in self.hashes):
            _keep(self._policies.file_of(self.source(policy)), folder)

    def damaged(self) -> Iterator[tuple[Path, str | None, str]]:
        """Files that are not as recorded: path, its hash (None: missing), recorded hash."""
        for policy, expected in self.hashes.items():
            path = self.place(policy)
            if (actual := self._hash_of(str(path))) != expected:
                yield path, actual, expected

    @property
    def _policies(self) -> Policies:
        return environment_of(self.task).policies

    def _hash_of(self, policy: str) -> str | None:
        """SHA-256 (hex) of a policy's file; None if it cannot be read."""
        try:
            return self._policies.hash_of(policy)
        except PolicyError:
            return None

    def _kept(self, digest: str) -> Iterator[Path]:
        return iter(()) if self.folder is None else self.folder.glob(f"{digest}.*")


def record_files(policies: Iterable[str], folder: Path, catalogue: Policies) -> dict[str, str]:
    """Copy the policies' files into a folder.

    Returns:
        Policy (name or path) -> SHA-256 (hex) of its file, without those that are code.

    PolicyError for a policy that is not there; StudyError when a file cannot be read or written.
    """
    with_files = [policy for policy in sorted(set(policies)) if not catalogue.is_rule(policy)]
    return {policy: _keep(catalogue.file_of(policy), folder) for policy in with_files}


def _keep(path: Path, folder: Path) -> str:
    """Copy a file into a folder under its SHA-256, which is of the copied bytes."""
    try:
        content = path.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise StudyError(f"cannot read the policy's file {path}: {reason}") from error
    digest = hashlib.sha256(content).hexdigest()
    write_bytes(folder / f"{digest}{path.suffix}", content)
    return digest
