"""The chain's head stamped by a time-stamping authority (RFC 3161) of the tests' own, and the stamp checked offline."""

import http.server
import re
import shutil
import sqlite3
import subprocess
import threading
from contextlib import closing

import pytest

from humanplay.db.erasure import forget
from humanplay.series.verification import verify_database
from tests.support.command import command
from tests.support.stored_studies import freeze, play_study, write_chain_anew

if shutil.which("openssl") is None:
    pytest.skip("openssl, which is the authority here, is not installed", allow_module_level=True)

CONFIG = """
[req]
distinguished_name = dn
[dn]
[root]
basicConstraints = critical, CA:TRUE
keyUsage = critical, keyCertSign
[leaf]
basicConstraints = CA:FALSE
extendedKeyUsage = critical, timeStamping
keyUsage = critical, digitalSignature
[tsa]
serial = serial
signer_cert = leaf.pem
signer_key = leaf.key
signer_digest = sha256
default_policy = 1.2.3.4.1
digests = sha256
"""


class Authority:
    """A root, a certificate that may stamp, and a server that does."""

    def __init__(self, folder):
        folder.mkdir()
        self.folder, self.root, self.answers = folder, folder / "root.pem", True
        (folder / "config").write_text(CONFIG)
        (folder / "serial").write_text("01\n")
        new = (
            "req",
            "-config",
            "config",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
        )
        self.run(
            *new,
            "-x509",
            "-subj",
            "/CN=Root",
            "-extensions",
            "root",
            "-keyout",
            "root.key",
            "-out",
            "root.pem",
        )
        self.run(*new, "-subj", "/CN=Authority", "-keyout", "leaf.key", "-out", "leaf.csr")
        self.run("x509", "-req", "-in", "leaf.csr", "-CA", "root.pem", "-CAkey", "root.key", "-CAcreateserial",
                 "-extfile", "config", "-extensions", "leaf", "-days", "30", "-out", "leaf.pem")  # fmt: skip

    def run(self, *args):
        subprocess.run(["openssl", *args], cwd=self.folder, check=True, capture_output=True)

    def stamp(self, request):
        (self.folder / "asked").write_bytes(request)
        self.run(
            "ts",
            "-reply",
            "-config",
            "config",
            "-section",
            "tsa",
            "-queryfile",
            "asked",
            "-out",
            "answer",
        )
        return (self.folder / "answer").read_bytes() if self.answers else b"nothing"


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    made = Authority(tmp_path_factory.mktemp("authority") / "a")

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            answer = made.stamp(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(200)
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    made.url = f"http://127.0.0.1:{server.server_port}"
    yield made
    server.shutdown()
    server.server_close()


@pytest.fixture
def database(tmp_path):
    path = tmp_path / "play.db"
    people = play_study(path, freeze(tmp_path / "play.db-studies"))
    return path, people


def run(capsys, *args):
    code, out, err = command(capsys, *args)
    return code, out + err


def test_a_stamp_says_when_the_head_stood_and_verify_what_came_after_it(
    capsys, tmp_path, authority, database
):
    path, people = database
    head = verify_database(path).chain
    code, said = run(capsys, "stamp", "--authority", authority.url, "--database", path)
    file = tmp_path / f"play.db-{head.entries}.tsr"
    assert (code, file.is_file(), head.head in said) == (0, True, True), said
    given = ("verify", "--database", path, "--stamp", file)
    code, said = run(capsys, *given, "--certificate", authority.root)
    assert code == 0
    assert re.search(r"time stamp of 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d UTC", said)
    assert f"the head {head.head} is that of entry {head.entries}" in said
    forget(path, people[0])
    code, said = run(capsys, *given, "--certificate", authority.root)
    assert (code, "since then: 1 of kind erased, 1 of kind forgotten" in said) == (0, True)


def test_openssl_itself_accepts_the_stamp(capsys, tmp_path, authority, database):
    path, _ = database
    assert (
        run(
            capsys,
            "stamp",
            "--authority",
            authority.url,
            "--database",
            path,
            "--out",
            tmp_path / "a.tsr",
        )[0]
        == 0
    )
    (tmp_path / "head").write_text(verify_database(path).chain.head)
    authority.run(
        "ts",
        "-verify",
        "-data",
        tmp_path / "head",
        "-in",
        tmp_path / "a.tsr",
        "-CAfile",
        "root.pem",
    )


def test_a_chain_that_was_made_anew_does_not_hold_the_head_that_was_stamped(
    capsys, tmp_path, authority, database
):
    """An operator changes a row by hand and writes the chain anew: all is consistent, and yet found."""
    path, people = database
    file = tmp_path / "a.tsr"
    run(capsys, "stamp", "--authority", authority.url, "--database", path, "--out", file)
    with closing(sqlite3.connect(path, isolation_level=None)) as conn:
        conn.execute("UPDATE participants SET settings = '{}' WHERE id = ?", [people[0]])
        write_chain_anew(conn)
    assert verify_database(path).findings == ()
    given = ("verify", "--database", path, "--stamp", file)
    code, said = run(capsys, *given, "--certificate", authority.root)
    assert (code, "no entry with the head that was stamped" in said) == (1, True)


def test_a_stamp_of_another_authority_or_a_changed_one_is_found(
    capsys, tmp_path, authority, database
):
    path, _ = database
    file = tmp_path / "a.tsr"
    run(capsys, "stamp", "--authority", authority.url, "--database", path, "--out", file)
    given = ("verify", "--database", path, "--stamp", file)
    other = Authority(tmp_path / "other")
    for certificate in (("--certificate", other.root), ()):
        code, said = run(capsys, *given, *certificate)
        assert (code, "signature" in said) == (1, True)
    content = bytearray(file.read_bytes())
    at = content.index(verify_head(path))
    content[at] ^= 1
    file.write_bytes(content)
    code, said = run(capsys, *given, "--certificate", authority.root)
    assert code == 1
    file.write_bytes(b"no stamp")
    code, said = run(capsys, *given, "--certificate", authority.root)
    assert (code, "give a file that `stamp` wrote" in said) == (1, True)


def verify_head(path):
    """Return the digest that stands in a stamp of the database's head."""
    import hashlib

    return hashlib.sha256(verify_database(path).chain.head.encode()).digest()


def test_an_authority_that_gives_no_stamp_leaves_no_file(capsys, tmp_path, authority, database):
    path, _ = database
    given = ("stamp", "--database", path, "--out", tmp_path / "a.tsr", "--authority")
    authority.answers = False
    try:
        assert run(capsys, *given, authority.url)[0] == 1
    finally:
        authority.answers = True
    for none in ("http://127.0.0.1:9", "no address"):
        code, said = run(capsys, *given, none)
        assert (code, "try again, or another --authority" in said) == (1, True)
    assert not (tmp_path / "a.tsr").exists()
