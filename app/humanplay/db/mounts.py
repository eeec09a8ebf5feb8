"""On what kind of file system a database lies."""

from __future__ import annotations

import re
from pathlib import Path

MOUNTS = Path("/proc/self/mounts")
NETWORKS = frozenset(
    {"nfs", "nfs4", "cifs", "smb3", "smbfs", "afs", "9p", "fuse.sshfs", "lustre", "beegfs"}
)
"""File systems of other machines, by the kernel's names."""
NETWORK = (
    "the database %s lies on a network file system (%s), whose locks SQLite cannot rely on: episodes can be lost. "
    "Put it on a disk of this machine (--database), and backups there (--backup-to)"
)


def network_file_system(path: Path, mounts: Path | None = None) -> str:
    """The kind of network file system of a path; "" for a disk, or if unknown."""
    try:
        lines = (mounts or MOUNTS).read_text(errors="replace").splitlines()
    except OSError:
        return ""
    place, nearest = path.resolve(), (Path(), "")
    for line in lines:
        _, folder, kind, *_ = line.split(" ")
        mount = Path(re.sub(r"\\([0-7]{3})", lambda code: chr(int(code[1], 8)), folder))
        if place.is_relative_to(mount) and len(mount.parts) >= len(nearest[0].parts):
            nearest = mount, kind
    return nearest[1] if nearest[1] in NETWORKS else ""
