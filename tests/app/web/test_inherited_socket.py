"""A socket that systemd holds: a restart refuses nobody."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading

import pytest

from humanplay.web.listening import ServerError, inherited_socket
from tests.support.browser import free_port
from tests.support.servers import PATIENCE_S, RunningServer, eventually


def begin_and_move(server):
    """Begin a board over HTTP, make a move over its socket; return client and board."""
    client = server.page()
    begun = client.post("/api/sessions", json={"size": [7, 9], "seed": 1}).json()
    with server.socket(begun["session"], client) as board:
        board.act(board.receive("frame"), "east", input="key")
        board.frame_after(0)
    return client, begun


def test_a_server_that_is_started_anew_on_the_same_socket_refuses_nobody(spawn):
    with socket.create_server(("127.0.0.1", 0)) as held:
        first = spawn(held)
        assert first.port == held.getsockname()[1]
        client, begun = begin_and_move(first)
        first.process.send_signal(signal.SIGTERM)
        first.process.wait(PATIENCE_S)
        answers = []

        def ask():  # while no server runs: the connection waits in the socket that is held
            answers.append(first.client().get("/healthz").status_code)

        asking = threading.Thread(target=ask)
        asking.start()
        second = spawn(held)
        asking.join(PATIENCE_S)
        assert answers == [200]
        assert client.get(f"/api/sessions/{begun['session']}").json()["step"] == 1
        begin_and_move(second)
        second.kill()
        first.close()


def test_a_socket_of_another_process_is_not_taken(monkeypatch):
    monkeypatch.setenv("LISTEN_FDS", "1")
    monkeypatch.setenv("LISTEN_PID", str(os.getpid() + 1))
    assert inherited_socket() is None


def test_two_sockets_are_refused_in_a_sentence(monkeypatch):
    monkeypatch.setenv("LISTEN_FDS", "2")
    monkeypatch.setenv("LISTEN_PID", str(os.getpid()))
    with pytest.raises(ServerError, match="expected one socket from systemd, got 2"):
        inherited_socket()
    assert "LISTEN_FDS" not in os.environ


@pytest.mark.long
@pytest.mark.skipif(shutil.which("systemd-socket-activate") is None, reason="needs systemd")
def test_systemd_passes_its_socket_on_to_the_command(tmp_path):
    port = free_port()
    variables = [f"--setenv={name}" for name in ("PATH", "PYTHONPATH", "HOME")]
    command = [
        "systemd-socket-activate",
        f"--listen=127.0.0.1:{port}",
        *variables,
        sys.executable,
        "-m",
        "humanplay.cli",
    ]
    command += ["serve", "--database", tmp_path / "play.db", "--port", "1"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        server = RunningServer(port)
        try:
            listening = ["ss", "-ltn", f"sport = :{port}"]
            eventually(lambda: b"LISTEN" in subprocess.check_output(listening))
            assert server.client().get("/healthz").status_code == 200
            begin_and_move(server)
        finally:
            server.close()
            process.terminate()
