"""A database on another machine's disk is warned of."""

from pathlib import Path

import pytest

from humanplay.db.mounts import network_file_system

LINES = """/dev/vda / ext4 rw 0 0
host:/export /mnt/lab nfs4 rw 0 0
/dev/vdb /mnt/lab/fast ext4 rw 0 0
//host/share /mnt/two\\040words cifs rw 0 0
"""


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/srv/a.db", ""),
        ("/mnt/lab/a.db", "nfs4"),
        ("/mnt/laboratory/a.db", ""),
        ("/mnt/lab/fast/a.db", ""),
        ("/mnt/two words/a.db", "cifs"),
    ],
)
def test_the_innermost_mount_says_what_a_path_lies_on(tmp_path, path, kind):
    (tmp_path / "mounts").write_text(LINES)
    assert network_file_system(Path(path), tmp_path / "mounts") == kind
    assert network_file_system(Path(path), tmp_path / "absent") == ""
