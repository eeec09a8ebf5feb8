"""Starting and stopping: a taken port, a foreign file, Ctrl-C, prefixes."""

import signal
import subprocess
import sys

import pytest

from humanplay.db.file import StoreError
from humanplay.web.listening import listen
from humanplay.web.server import ServerError, run
from humanplay.web.settings import Settings
from marsexplorer.compiled import compiling
from tests.support.policy_files import write_onnx
from tests.support.servers import PATIENCE_S


def test_an_address_of_another_machine_is_reported():
    message = r"cannot listen on 203\.0\.113\.1 .*choose another with --host"
    with pytest.raises(ServerError, match=message):
        listen("203.0.113.1", 0)
    with pytest.raises(ServerError, match="cannot listen on no such host"):
        listen("no such host", 0)


def test_a_policy_file_that_is_none_is_reported(tmp_path):
    path = tmp_path / "model.onnx"
    path.write_bytes(b"no policy at all")
    write_onnx(tmp_path / "other.onnx", logits=5, value=False)
    for source in (path, tmp_path / "absent.onnx", tmp_path / "other.onnx"):
        with pytest.raises(ServerError, match=source.name):
            run(Settings(port=0, database=tmp_path / "new.db", policies=(source,)))
    assert not (tmp_path / "new.db").exists()


@pytest.mark.parametrize("fault", ["map", "database"])
def test_a_process_compiles_for_itself_after_a_failed_start(fault, tmp_path):
    database = tmp_path / "play.db"
    maps = (tmp_path / "absent.yaml",) if fault == "map" else ()
    if fault == "database":
        database.write_bytes(b"no database at all" * 100)
    with pytest.raises((ServerError, StoreError)):
        run(Settings(port=0, database=database, maps=maps))
    assert compiling.instead is None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_server_closes_cleanly_with_a_socket_open(spawn, number):
    server = spawn()
    client = server.client()
    begun = client.post("/api/sessions", json={"rival": "frontier-cost"}).json()
    with server.socket(begun["session"], client) as board:
        board.receive("history")
        server.process.send_signal(number)
        server.process.wait(PATIENCE_S)
    output = server.process.stdout.read()
    assert "Traceback" not in output
    assert "Error" not in output
    server.close()
    assert server.process.returncode == 0


def test_what_is_there_at_the_start_is_not_looked_at_again():
    """Collecting garbage of all ages took 169 ms of every move that met it."""
    code = """
import asyncio, gc, uvicorn
from fastapi import FastAPI
from humanplay.web.listening import AnnouncingServer, listen
async def start():
    gc.disable()
    server = AnnouncingServer(uvicorn.Config(FastAPI(), lifespan="off"), "http://nowhere", print)
    server.config.load()
    server.lifespan = server.config.lifespan_class(server.config)
    await server.startup([listen("127.0.0.1", 0)])
    print(gc.isenabled() and gc.get_freeze_count() > 10 * len(gc.get_objects()))
asyncio.run(start())
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "True"


def test_the_app_can_be_imported_without_a_side_effect(tmp_path):
    code = "import humanplay.web.server, pathlib, sys; assert not list(pathlib.Path('.').iterdir()); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True
    )
    slow_to_import = {"torch", "scipy.stats", "pandas", "matplotlib"}
    assert slow_to_import.isdisjoint(done.stdout.decode().split())


def test_kept_alive_requests_are_answered_without_waiting_for_an_acknowledgement(server):
    client = server.client()
    client.get("/api/health")
    spent = sorted(client.get("/api/health").elapsed.total_seconds() for _ in range(21))
    assert spent[0] < 0.03, "the wait of 40 ms would be in every answer, a busy machine is in some"
