"""nginx with TLS for the tests, with its own certificate, on this machine alone."""

import re
import shutil
import ssl
import subprocess
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.support.servers import eventually

CONFIG = Path(__file__).parents[2] / "deploy" / "nginx" / "humanplay.conf"
STREAM = CONFIG.with_name("humanplay-stream.conf")
MODULE = Path("/usr/lib/nginx/modules/ngx_stream_module.so")
AROUND = """{module} user root; daemon off; worker_processes 1; pid {folder}/nginx.pid; error_log {folder}/error.log;
events {{ worker_connections 8192; }}
{stream}
http {{
  client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy 1 2; fastcgi_temp_path {folder}/f;
  uwsgi_temp_path {folder}/u; scgi_temp_path {folder}/s; access_log {folder}/access.log;
  {site}
}}
"""
PREFIXED = """
daemon off; worker_processes 1; pid {folder}/nginx.pid; error_log {folder}/error.log;
events {{ worker_connections 256; }}
http {{
  access_log off;
  client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy; fastcgi_temp_path {folder}/f;
  uwsgi_temp_path {folder}/u; scgi_temp_path {folder}/s;
  map $http_upgrade $connection_upgrade {{ default upgrade; '' close; }}
  server {{
    listen 127.0.0.1:{port} ssl;
    ssl_certificate {folder}/certificate.pem; ssl_certificate_key {folder}/key.pem;
    location /mars/ {{
      proxy_pass http://127.0.0.1:{upstream}/;
      proxy_http_version 1.1;
      proxy_set_header Upgrade $http_upgrade;
      proxy_set_header Connection $connection_upgrade;
      proxy_set_header Host $http_host;
      proxy_set_header X-Forwarded-Proto $scheme;
    }}
  }}
}}
"""
"""The playground below /mars/, with TLS; it is formatted once more by `running_nginx`."""
SPLIT = "\n# -- stream --\n"


def trusting():
    """What takes the certificate of these tests for good.

    TLS 1.2, because the client reads and writes in two threads: a session ticket of TLS 1.3 that is
    read while the request is written can keep OpenSSL from ever sending the request.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    return context


def shipped(front, plain, port, *changes):
    """The shipped files as one, with other ports, paths and host name.

    And with a test's own changes.

    front, plain  ports of nginx for https and http; `port` is the server's
    """
    both = f"{CONFIG.read_text()}{SPLIT}{STREAM.read_text()}"
    for was, now in (
        ("/etc/letsencrypt/live/mars.example/fullchain.pem", "{folder}/certificate.pem"),
        ("/etc/letsencrypt/live/mars.example/privkey.pem", "{folder}/key.pem"),
        ("/var/log/nginx/humanplay.log", "{folder}/site.log"),
        ("/run/humanplay-front.sock", "{folder}/front.sock"),
        ("listen 443 ssl", f"listen 127.0.0.1:{front} ssl"),
        ("listen 80", f"listen 127.0.0.1:{plain}"),
        ("server 127.0.0.1:8000", f"server 127.0.0.1:{port}"),
        ("server_name mars.example", "server_name localhost"),
        *changes,
    ):
        assert was in both, was
        both = both.replace(was, now)
    site, stream = re.sub(r"listen \[::\].*", "", both).split(SPLIT)
    module = f"load_module {MODULE};" if MODULE.exists() else ""
    return AROUND.format(folder="{folder}", site=site, stream=stream, module=module)


@contextmanager
def running_nginx(folder, text):
    """Run nginx in a new folder with a configuration; {folder} is that of its files."""
    folder.mkdir()
    subject = ["-subj", "/CN=localhost", "-days", "2", "-nodes", "-newkey", "rsa:2048", "-x509"]
    files = ["-keyout", folder / "key.pem", "-out", folder / "certificate.pem"]
    subprocess.run(["openssl", "req", *subject, *files], check=True, capture_output=True)
    (folder / "nginx.conf").write_text(text.replace("{folder}", str(folder)))
    command = ["nginx", "-p", folder, "-c", "nginx.conf"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            eventually(lambda: (folder / "nginx.pid").exists())
            yield
        finally:
            process.terminate()


@pytest.fixture
def nginx(tmp_path):
    """`nginx(text)` starts nginx as `running_nginx` does, and returns the folder."""
    if shutil.which("nginx") is None or shutil.which("openssl") is None:
        pytest.skip("NO NGINX OR OPENSSL: install them to run the proxy test")
    with ExitStack() as stack:

        def start(text):
            stack.enter_context(running_nginx(tmp_path / "nginx", text))
            return tmp_path / "nginx"

        yield start
