"""nginx with TLS for the tests: with a certificate of its own, on this machine alone."""

import shutil
import subprocess

import pytest

from tests.support.servers import eventually


@pytest.fixture
def nginx(tmp_path):
    """`nginx(text)` starts nginx with this configuration, in which {folder} is where its files are, and returns the folder."""
    if shutil.which("nginx") is None or shutil.which("openssl") is None:
        pytest.skip("NO NGINX OR OPENSSL: install them to run the proxy test")
    running = []

    def start(text):
        folder = tmp_path / "nginx"
        folder.mkdir()
        subject = ["-subj", "/CN=localhost", "-days", "2", "-nodes", "-newkey", "rsa:2048", "-x509"]
        files = ["-keyout", folder / "key.pem", "-out", folder / "certificate.pem"]
        subprocess.run(["openssl", "req", *subject, *files], check=True, capture_output=True)
        (folder / "nginx.conf").write_text(text.replace("{folder}", str(folder)))
        command = ["nginx", "-p", folder, "-c", "nginx.conf"]
        running.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        eventually(lambda: (folder / "nginx.pid").exists())
        return folder

    yield start
    for process in running:
        process.terminate()
        process.wait()
