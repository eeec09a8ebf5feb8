"""Replays over HTTP: the page, its preview, and a policy on its terrain."""

import json
import re
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from html.parser import HTMLParser

import httpx
import pytest

from humanplay.db.store import Store
from humanplay.web.replays import service
from tests.support import job_functions
from tests.support.recorded import add_session, open_episode, play
from tests.support.servers import eventually


class Page(HTMLParser):
    """What these tests read of a page: its meta tags by name, and the data in it."""

    def __init__(self, text):
        super().__init__()
        self.metas, self.data, self._is_data = {}, "", False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "meta":
            self.metas[values.get("property") or values.get("name")] = values.get("content")
        self._is_data = values.get("id") == "replay-data"

    def handle_data(self, data):
        if self._is_data:
            self.data += data

    def handle_endtag(self, tag):
        self._is_data = False


def recorded(path, **rest):
    """The ids of an episode that has been explored, and of one that runs."""
    store = Store(path)
    ended = play(store, 3, explore=True, **rest)
    running, _ = open_episode(store, add_session(store), 5)
    store.close()
    return ended.id, running.id


def test_the_page_of_an_ended_episode_holds_its_course_and_a_preview_with_absolute_addresses(
    serve, tmp_path
):
    ended, running = recorded(tmp_path / "playground.db")
    client = serve(public_url="https://mars.example").client()
    answer = client.get(f"/replay/{ended}", headers={"Host": "mars.example"})
    page = Page(answer.text)
    data = json.loads(page.data)
    assert data == client.get(f"/api/episodes/{ended}/replay").json()
    moves = len(data["run"]["actions"])
    assert page.metas["og:title"] == f"A person mapped 100.0 % of the ground in {moves} moves"
    assert page.metas["og:url"] == f"https://mars.example/replay/{ended}"
    assert page.metas["og:image"] == f"https://mars.example/replay/{ended}.png"
    assert data["preferred"] == "ppo"
    ghost = client.get(f"/api/episodes/{ended}/ghost", params={"policy": "frontier-cost"}).json()
    assert ghost["name"] == "frontier-cost"
    assert ghost["positions"][0] == data["run"]["positions"][0]
    assert client.get(f"/api/episodes/{ended}/ghost?policy=nobody").status_code == 422
    for id_ in (running, "none", "..%2F..%2Fetc"):
        assert client.get(f"/api/episodes/{id_}/replay").status_code == 404
        assert client.get(f"/api/episodes/{id_}/ghost?policy=random").status_code == 404
    assert client.get("/replay/none").status_code == 404
    assert client.get(f"/replay/{running}").headers["location"] == f"../watch/{running}"


@pytest.mark.skipif(sys.platform != "linux", reason="one machine has many addresses there alone")
def test_an_address_with_34_questions_has_two_that_wait_and_keeps_no_ghost_from_another(
    serve, tmp_path
):
    ended, _ = recorded(tmp_path / "playground.db")
    server = serve()
    for _ in range(3):
        eventually(lambda: server.services.jobs.waiting() < 2)
        server.services.jobs.submit(job_functions.sleep, 600, owner="127.0.0.2")
    greedy, other = (
        server.client(transport=httpx.HTTPTransport(local_address=f"127.0.0.{number}"))
        for number in (2, 3)
    )
    ghost = f"/api/episodes/{ended}/ghost?policy=frontier-cost"
    with ThreadPoolExecutor(34) as connections:
        refused = list(connections.map(greedy.get, [ghost] * 34))
    assert {(answer.status_code, answer.headers["Retry-After"]) for answer in refused} == {
        (503, "5")
    }
    assert min(answer.elapsed.total_seconds() for answer in refused) >= 1, "no faster than that"
    assert other.get(ghost).status_code == 200


@pytest.mark.skipif(sys.platform != "linux", reason="one machine has many addresses there alone")
def test_replays_are_kept_and_those_of_one_address_delay_neither_boards_nor_probes_nor_anothers_twice(
    serve, tmp_path, monkeypatch
):
    with closing(Store(tmp_path / "playground.db")) as store:
        replays = [f"/api/episodes/{play(store, seed).id}/replay" for seed in range(13)]
    begun, goes_on, make = [], threading.Semaphore(0), service.courses_of

    def wait_and_make(episode, served):
        begun.append(f"/api/episodes/{episode.id}/replay")
        assert goes_on.acquire(timeout=20)
        return make(episode, served)

    monkeypatch.setattr(service, "courses_of", wait_and_make)
    server = serve()
    greedy, other = (
        server.client(transport=httpx.HTTPTransport(local_address=f"127.0.0.{number}"))
        for number in (2, 3)
    )
    with ThreadPoolExecutor(13) as connections:
        asked = [connections.submit(greedy.get, replay) for replay in replays[:12]]
        eventually(lambda: begun)
        assert other.post("/api/sessions", json={}, timeout=5).status_code == 201
        assert other.get("/readyz", timeout=5).status_code == 200
        asked.append(connections.submit(other.get, replays[12]))
        eventually(lambda: server.services.replayer._thread._work_queue.qsize())
        goes_on.release(13)
        assert {request.result().status_code for request in asked} == {200}
    assert begun.index(replays[12]) == 1
    assert other.get(replays[12]).json() == asked[12].result().json()
    assert len(begun) == 13


def test_a_ghost_that_takes_too_long_is_ended_and_not_tried_again(serve, tmp_path, monkeypatch):
    ended, _ = recorded(tmp_path / "playground.db")
    client = serve().client()
    ghost = f"/api/episodes/{ended}/ghost?policy=frontier-cost"
    monkeypatch.setattr("humanplay.web.replays.service.GHOST_S", 1e-4)
    assert "took longer than 0.0001 s" in client.get(ghost).json()["detail"]
    monkeypatch.undo()
    again = client.get(ghost)
    assert (again.status_code, again.headers["Retry-After"]) == (503, "600")


def test_a_file_that_is_kept_asks_for_no_ghost_again(serve, tmp_path, monkeypatch):
    monkeypatch.setattr(service, "MAX_COURSES", 1)
    ended, _ = recorded(tmp_path / "playground.db")
    server = serve()
    client = server.client()
    page = f"/replay/{ended}.html?ghost=frontier-cost"
    file = client.get(page)
    assert file.status_code == 200, file.text
    other = client.get(f"/api/episodes/{ended}/ghost?policy=ppo")
    assert other.status_code == 200, other.text  # its course takes the only place
    monkeypatch.setattr(service.Replays, "_ghost", None)
    assert client.get(page).content == file.content


def test_a_player_finds_themselves_in_their_replay_and_nobody_else_does(serve):
    server = serve()
    me, stranger = server.client(), server.client()
    about = me.post("/api/sessions", json={"size": [5, 7]}, headers={"Origin": server.url}).json()
    episode = about["frame"]["episode"]
    act = {"episode": episode, "step": 0, "action": "north"}
    ended = me.post(f"/api/sessions/{about['session']}/act", json=act).json()
    assert ended["outcome"] == "out_of_bounds"
    shown = [client.get(f"/api/episodes/{episode}/replay").json() for client in (me, stranger)]
    assert [replay["run"]["name"] for replay in shown] == ["You", "A script"]
    title = Page(me.get(f"/replay/{episode}").text).metas["og:title"]
    assert title.startswith("You drove off the map at ")
    files = [client.get(f"/replay/{episode}.html?ghost=none").text for client in (me, stranger)]
    assert files[0] == files[1], "a file is for whoever it is given to"


def test_a_name_from_outside_is_text_in_the_page_and_nothing_else(serve, tmp_path):
    script = "</script><script>alert(1)</script><b title=\"x'"
    ended, _ = recorded(tmp_path / "playground.db", driver=f"policy:{script}")
    client = serve(trusted_proxies=["127.0.0.1"]).client()
    refused = client.get(f"/replay/{ended}", headers={"Host": 'mars"><script>alert(2)</script>'})
    assert refused.status_code == 400
    prefix = {"X-Forwarded-Prefix": '/"><script>alert(2)</script>'}
    answer = client.get(f"/replay/{ended}", headers=prefix)
    page = Page(answer.text)
    assert json.loads(page.data)["run"]["name"] == script
    assert page.metas["og:title"].startswith(script)
    assert not re.search(r"<script>alert", answer.text)
