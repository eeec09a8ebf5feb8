"""A server that has compiled nothing: the page comes at once."""

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest

from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.tasks.mars.task import EXAMPLES
from marsexplorer.policies import load, names
from tests.support.fresh_machine import children, fresh_server, processor_s
from tests.support.level_examples import examples
from tests.support.servers import RunningServer

FIRST_PAGE_S = 6.0
"""Processor seconds at most, on a busy machine; research.speed.first_minute measures them."""
SERVER_S = 12.0
"""Processor seconds at most of a server that has loaded what others compiled."""
MOVE_P99_S = 0.05
COMPILING_S = 240.0


def move_until(done, client, board):
    """Drive a rover to and fro until `done()`; return the seconds of each move."""
    frame, took = board["frame"], []
    there, back = ("east", "west") if frame["grid"][0][1] == "." else ("south", "north")
    while not done():
        if frame["step"] == 400:
            board = client.post(f"/api/sessions/{board['session']}/episodes", json={}).json()
            frame = board["frame"]
            there, back = ("east", "west") if frame["grid"][0][1] == "." else ("south", "north")
        move = {
            "episode": frame["episode"],
            "step": frame["step"],
            "action": back if frame["step"] % 2 else there,
        }
        began = time.perf_counter()
        answer = client.post(f"/api/sessions/{board['session']}/act", json=move)
        took.append(time.perf_counter() - began)
        assert answer.status_code == 200, answer.text
        frame = answer.json()
        time.sleep(0.05)
    return took


@pytest.mark.alone
@pytest.mark.skipif(sys.platform != "linux", reason="processor seconds are read from /proc")
@pytest.mark.timeout(2 * COMPILING_S)
def test_on_a_fresh_machine_the_page_comes_at_once_and_moves_stay_quick_while_boards_are_compiled(
    tmp_path,
):
    with fresh_server(tmp_path / "cache", tmp_path / "moves.db") as (process, port):
        server = RunningServer(port)
        client = server.client()
        client.timeout = httpx.Timeout(COMPILING_S)
        assert client.get("/").status_code == 200
        beside = children(process)
        assert processor_s(process, *beside) < FIRST_PAGE_S
        assert [os.getpriority(os.PRIO_PROCESS, child) for child in beside] == [19]
        assert len(client.get("/api/levels").json()) > 10
        assert client.get("/api/health").json()["getting_ready"].startswith("getting ready: ")
        board = client.post("/api/sessions", json={"seed": 5}).json()
        assert client.get("/api/health").json()["getting_ready"] is None

        watched = client.post("/api/sessions", json={"player": "lookahead", "size": 14}).json()
        with server.socket(watched["session"], client) as watcher:
            detail = watcher.receive("error")["detail"]
        assert detail.startswith("the policy 'lookahead' is getting ready: ")
        with ThreadPoolExecutor(1) as pool:
            cave = pool.submit(client.post, "/api/sessions", json={"level": "cave"})
            took = move_until(cave.done, server.client(), board)
        assert cave.result().status_code == 201
        assert len(took) > 20
        assert np.quantile(took, 0.99) < MOVE_P99_S
        assert processor_s(process) < SERVER_S
        server.close()
    assert list((tmp_path / "cache").rglob("*draw_other*.nbc"))


def test_the_terrains_that_stand_for_levels_are_those_that_are_drawn(server):
    assert EXAMPLES.is_file()
    shown = {level["name"]: level["example"] for level in server.client().get("/api/levels").json()}
    assert shown == examples()


def test_a_shipped_policy_plays_every_size_as_the_catalogue_says():
    offers = {offer.name: offer.size for offer in PolicyCatalogue().offers()}
    assert offers == {name: getattr(load(name), "size", None) for name in names()}
