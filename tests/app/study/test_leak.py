"""Nothing of an open study reaches anybody but its participants, and they see their own boards alone."""

import json
import re
import secrets
from contextlib import ExitStack

import msgspec
import pytest
from numpy import packbits
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.series.folder import Folder
from app.tasks.mars.viewer3d.viewer import PROTOCOL
from marsexplorer.terrain import generate
from tests.support.page_loads import LOAD
from tests.support.servers import PATIENCE_S, eventually, forged
from tests.support.study import Person, freeze
from tests.support.viewer3d import View


@pytest.fixture
def study(tmp_path):
    return freeze(tmp_path / "studies")


@pytest.fixture
def played(server, study):
    """A server with a participant at the debrief and one on a ranked episode, three moves in."""
    done, person = Person(server, outside_ids={"PROLIFIC_PID": "secret-pid-1"}), Person(server)
    for each in (done, person):
        each.to_warm_up()
    done.play_on()
    person.play_on(until=("ranked",))
    person.call("next")
    person.play(moves=3)
    person.me()
    return done, person


def secrets_of(study):
    """All that would reveal a terrain: secret, seeds, packed maps."""
    seeds = study.seeds()
    maps = [generate(study.protocol.env_config, seed) for seed in seeds]
    return [
        study.secret.hex(),
        *map(str, seeds),
        *(packbits(each).tobytes().hex() for each in maps),
    ]


def public_urls(server, episodes):
    """Every GET of the schema without a body of its own, filled with the ids of the study."""
    for path, calls in server.app.openapi()["paths"].items():
        if "get" not in calls:
            continue
        filled = {"table": "episodes", "fmt": "csv", "name": "small", "index": "0"}
        for episode in episodes if "episode_id" in path else [""]:
            url = path
            for hole, value in {**filled, "episode_id": episode}.items():
                url = url.replace(f"{{{hole}}}", value)
            yield from dict.fromkeys((url, url.replace("/export/episodes", "/export/steps")))


def test_no_public_endpoint_tells_anything_of_an_open_studys_episodes(server, study, played):
    done, person = played
    episodes = [
        row[0]
        for row in server.services.store.connection.execute("SELECT id FROM episodes").fetchall()
    ]
    assert len(episodes) == 6 + 4
    hidden = [
        *secrets_of(study),
        *episodes,
        done.where["session"],
        person.where["session"],
        "secret-pid-1",
    ]
    stranger = server.client()
    asked = set()
    for url in public_urls(server, episodes):
        asked.add(url)
        if "{" in url:
            url = re.sub(r"\{session_id\}", person.where["session"], url)
        for who in ("", "?who=human", "?limit=200"):
            answer = stranger.get(url + who)
            allowed = {each for each in hidden if each in url}  # a 404 may name what was asked for
            found = [each for each in hidden if each not in allowed and each in answer.text]
            assert not found, (url, found)
            assert answer.status_code in (200, 404, 409, 422), (url, answer.status_code)
            if url == "/api/me/session":
                assert answer.text == "null"  # a stranger has no board of the page
            elif url.startswith("/api/me/"):
                assert answer.status_code in (200, 404), (
                    url
                )  # of a stranger's own, which is nothing: see `found`
            elif "/sessions/" in url or "/me" in url or "/debrief" in url or "/episodes/" in url:
                assert answer.status_code == 404, url
    assert {
        "/api/episodes",
        "/api/export/steps.csv",
        "/api/human-level",
        "/api/studies/small/me",
    } <= asked
    assert stranger.get("/api/episodes").json() == []
    assert stranger.get("/api/export/episodes.csv").text.count("\n") == 1
    assert stranger.get("/api/export/steps.csv").text.count("\n") == 1


def test_a_participant_gets_the_warm_up_terrains_in_the_debrief_and_no_ranked_one(
    server, study, played
):
    done, person = played
    texts = [done.client.get(f"{done.url}/debrief/{index}").text for index in range(2)]
    texts += [json.dumps(done.me()), json.dumps(person.me()), done.client.get("/api/episodes").text]
    assert not [each for each in secrets_of(study) if any(each in text for text in texts)]
    assert person.client.get(f"{person.url}/debrief/0").status_code == 409
    assert person.client.get(f"/api/sessions/{done.where['session']}").status_code == 404
    running = person.client.get(f"/api/episodes/{person.frame['episode']}")
    assert running.status_code == 404, "not even one's own, with its seed, while it runs"


def test_once_the_study_is_closed_its_episodes_are_public_and_the_debrief_shows_ranked_terrains(
    server, study, played, tmp_path
):
    done, person = played
    ranked = [
        f"{done.url}/debrief/{index}{end}?phase=ranked"
        for index in range(3)
        for end in ("", "/costs")
    ]
    assert {done.client.get(url).status_code for url in ranked} == {409}
    assert done.me()["debrief"]["ranked_terrains"] == 0
    Folder(tmp_path / "studies").close("small")
    stranger = server.client()
    assert stranger.get("/api/studies/small").json()["secret"] == study.secret.hex()
    assert len(stranger.get("/api/episodes").json()) == 6 + 4, "one was open, and is abandoned"
    assert str(study.seeds()[0]) in stranger.get("/api/export/episodes.csv").text
    count = done.me()["debrief"]["ranked_terrains"]
    assert count == len(done.me()["debrief"]["episodes"]) > 0
    for index in range(count):
        found = done.client.get(f"{done.url}/debrief/{index}?phase=ranked").json()
        own, its = found["own"], found["policy"]["frames"]
        trial = done.me()["debrief"]["episodes"][index]
        assert (own[-1]["step"], own[-1]["outcome"]) == (trial["steps"], trial["outcome"])
        assert (own[0]["grid"], its[0]["step"]) == (its[0]["grid"], 0), (
            "the policy drives on the same terrain"
        )
        assert (
            done.client.get(f"{done.url}/debrief/{index}/costs?phase=ranked").json()["policy"]
            == "ppo"
        )
    assert done.client.get(f"{done.url}/debrief/{count}?phase=ranked").status_code == 404
    assert person.client.get(f"{person.url}/debrief/0?phase=ranked").status_code == 409, (
        "they have not come so far"
    )


def test_a_board_is_its_participants_alone(server, study, played):
    done, person = played
    session, frame = person.where["session"], person.frame
    stranger, forger = server.client(), server.client()
    stranger.post("/api/sessions")
    name, value = next(iter(dict(person.client.cookies).items()))
    forger.cookies.set(name, forged(value))
    for client in (server.client(), stranger, done.client, forger):
        check_that_it_is_unknown(server, session, frame, client)
    assert person.me()["about"]["frame"] == frame
    history = person.client.get(f"/api/sessions/{session}/history").json()
    assert history["episode"] == frame["episode"]
    assert person.client.get(f"/viewer/{session}/").status_code == 200
    with ExitStack() as stack:
        assert View(server, session, stack, person.client).read("/border")


def check_that_it_is_unknown(server, session, frame, client):
    """To this client a session is one that does not exist, over HTTP and both sockets."""
    act = {"episode": frame["episode"], "step": frame["step"], "action": "south"}
    unknown = client.get("/api/sessions/nobody").json()["detail"].replace("nobody", session)
    for method, path, body in (
        ("GET", "", None), ("GET", "/about", None), ("GET", "/history", None),
        ("POST", "/act", act), ("POST", "/episodes", {}), ("POST", "/pace", {"pause": True}),
    ):  # fmt: skip
        answer = client.request(method, f"/api/sessions/{session}{path}", json=body)
        assert (answer.status_code, answer.json()["detail"]) == (404, unknown)
    assert client.get(f"/viewer/{session}/").status_code == 404
    with server.socket(session, client) as socket:
        assert socket.receive()["detail"] == unknown
        with pytest.raises(ConnectionClosed) as closed:
            socket.receive()
        assert closed.value.rcvd.code == 4404
    cookies = "; ".join(f"{each.name}={each.value}" for each in client.cookies.jar)
    url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
    given = {"additional_headers": {"Cookie": cookies}, "origin": server.url, "proxy": None}
    with connect(url, subprotocols=[PROTOCOL], **given) as view:
        with pytest.raises(ConnectionClosed) as closed:
            view.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd.code == 4404


def test_the_operator_sees_a_board_and_cannot_move_it(server, study, played, monkeypatch):
    _, person = played

    async def is_operator(connection):
        return connection.headers.get("x-admin") == "yes"

    monkeypatch.setattr("app.web.access.is_operator", is_operator)
    admin = server.client(headers={"X-Admin": "yes"})
    session, frame = person.where["session"], person.frame
    assert admin.get(f"/api/sessions/{session}").json() == frame
    with server.socket(session, admin, **{"X-Admin": "yes"}) as socket:
        assert socket.receive("frame") == frame
        socket.act(frame, "south", input="key")
        assert "nobody else can move its rover" in socket.receive("refused")["reason"]
        socket.send(
            {
                "kind": "events",
                "batch": secrets.token_hex(8),
                **LOAD,
                "episode": frame["episode"],
                "events": [{"kind": "blur", "client_ms": 1}],
            }
        )
        assert "nobody else" in socket.receive("kept")["reason"]
    assert person.me()["about"]["frame"] == frame


def test_scores_of_ranked_episodes_are_null_in_every_answer_until_the_debrief(server, study):
    person = Person(server)
    person.to_warm_up()
    person.play_on(until=("ranked",))
    person.call("next")
    session = person.where["session"]
    names = ("reward", "return", "score")
    with ExitStack() as stack:
        view = View(server, session, stack, person.client)
        scene = view.read("/border")
        frames = person.play(moves=3)
        stale = {"episode": "x", "step": 0, "action": "east"}
        with person.socket() as socket:
            frames.append(socket.receive("frame"))
            socket.send({"kind": "act", **stale})
            frames.append(socket.receive("refused")["frame"])
            socket.send({"kind": "history"})
            history = socket.receive("history")
        frames.append(person.client.get(f"/api/sessions/{session}").json())
        frames.append(person.client.get(f"/api/sessions/{session}/about").json()["frame"])
        frames.append(person.me()["about"]["frame"])
        scene += view.read("/trail/")
    assert all(frame[name] is None for frame in frames for name in names)
    assert set(history) == {"kind", "episode", "positions", "discovered"}
    texts = [message["text"] for message in map(msgspec.msgpack.decode, scene) if "text" in message]
    assert not [text for text in texts if "score" in str(text).lower()]
    person.play_on()
    shown = eventually(lambda: person.client.get(f"/api/sessions/{session}").json())
    assert None not in [shown[name] for name in names]
