"""Nothing of an open study reaches anybody but its participants."""

import io
import json
import re
import zipfile
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from functools import partial

import msgspec
import pytest
from numpy import packbits
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from humanplay.report.build import build
from humanplay.report.cautions import cautions
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.verification import verify_database
from humanplay.tasks.mars.viewer3d.viewer import PROTOCOL
from marsexplorer.terrain import generate
from tests.support.command import command
from tests.support.servers import PATIENCE_S, eventually, forged
from tests.support.study import Person, freeze
from tests.support.viewer3d import View


@pytest.fixture
def study(tmp_path):
    return freeze(tmp_path / "playground.db-studies")


@pytest.fixture
def played(server, study):
    """A server with a participant at the debrief and one within a ranked episode."""
    done, person = Person(server, outside_ids={"PROLIFIC_PID": "secret-pid-1"}), Person(server)
    for somebody in (done, person):
        somebody.to_warm_up()
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
        *(packbits(map_).tobytes().hex() for map_ in maps),
    ]


def public_urls(server, episodes):
    """Every GET of the schema without a body, filled with the IDs of the study."""
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
            allowed = {
                secret for secret in hidden if secret in url
            }  # a 404 may name what was asked for
            leaked = [
                secret for secret in hidden if secret not in allowed and secret in answer.text
            ]
            assert not leaked, (url, leaked)
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
    assert not [secret for secret in secrets_of(study) if any(secret in text for text in texts)]
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
    Folder(tmp_path / "playground.db-studies").close("small")
    stranger = server.client()
    assert stranger.get("/api/studies/small").json()["secret"] == study.secret.hex()
    assert len(stranger.get("/api/episodes").json()) == 6 + 4, "one was open, and is abandoned"
    assert str(study.seeds()[0]) in stranger.get("/api/export/episodes.csv").text
    count = done.me()["debrief"]["ranked_terrains"]
    assert count == len(done.me()["debrief"]["episodes"]) > 0
    for index in range(count):
        debrief = done.client.get(f"{done.url}/debrief/{index}?phase=ranked").json()
        mine, its = debrief["own"], debrief["policy"]["frames"]
        trial = done.me()["debrief"]["episodes"][index]
        assert (mine[-1]["step"], mine[-1]["outcome"]) == (trial["steps"], trial["outcome"])
        assert (mine[0]["grid"], its[0]["step"]) == (its[0]["grid"], 0), (
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
    check_that_the_view_is_unknown(server, session, client)


def check_that_the_view_is_unknown(server, session, client):
    cookies = "; ".join(f"{cookie.name}={cookie.value}" for cookie in client.cookies.jar)
    url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
    options = {"additional_headers": {"Cookie": cookies}, "origin": server.url, "proxy": None}
    with connect(url, subprotocols=[PROTOCOL], **options) as view:
        with pytest.raises(ConnectionClosed) as closed:
            view.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd.code == 4404


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


PASSWORD = "red-planet-4"
OF_THE_MOMENT = ("now_ms", "health", "actions", "code_until_ms", "up_s")
"""What differs from one moment to the next whoever plays: times, and the server's health."""
SHOWN_TO_THE_OPERATOR = r'("(?:minutes|connections)":)\d+'
"""How long somebody has been here in all, and how often they connected: the operator alone sees it."""


@pytest.fixture
def open_study(serve, study):
    """A server with an operator, one person at ranked episodes and one at the warm-up."""
    server = serve(admin_password=PASSWORD)
    playing, other = Person(server), Person(server)
    for somebody in (playing, other):
        somebody.to_warm_up()
    playing.play_on(until=("ranked",))
    playing.call("next")
    operator = server.page()
    assert operator.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    return (
        server,
        playing,
        {"stranger": server.client(), "other": other.client, "operator": operator},
    )


def all_reads(server, person):
    """Every GET of the app, in the schema or not, filled with the person's IDs."""
    ids = {"session_id": person.where["session"], "watch_id": person.frame["episode"],
           "episode_id": person.frame["episode"], "name": "small", "index": "0", "table": "episodes", "form": "html",
           "board": "1", "day": "2026-11-22", "token": "none", "env": "none", "version": "none", "file": "small-report.json",
           "file:path": "opening.json", "puzzle": "1", "name:path": "common/base.css"}  # fmt: skip
    for route in server.app.routes:
        if "GET" not in (getattr(route, "methods", None) or ()):
            continue
        for path in dict.fromkeys((route.path, route.path.replace("{table}", "steps"))):
            yield path, re.sub(r"\{([a-z_:]+)\}", lambda hole: ids[hole[1]], path)


def unzipped(content):
    archive = zipfile.ZipFile(io.BytesIO(content))
    return "".join(archive.read(name).decode() for name in archive.namelist())


def answers(server, person, clients):
    """What everybody but the participant is answered, by who asks and for what.

    Times and the server's health are left out.
    """
    texts = {}
    with person.socket():  # a board that nobody is at is not live
        for path, url in all_reads(server, person):
            for who, client in clients.items():
                answer = client.get(url, follow_redirects=True)
                text = unzipped(answer.content) if url.endswith(".zip") else answer.text
                for ident in (person.where["session"], person.frame["episode"]):
                    text = text.replace(ident, "ID")
                if who == "operator":
                    text = re.sub(SHOWN_TO_THE_OPERATOR, r"\g<1>0", text)
                if text.startswith("{"):
                    text = {
                        key: part
                        for key, part in json.loads(text).items()
                        if key not in OF_THE_MOMENT
                    }
                texts[who, path] = text
    return texts


def test_what_a_participant_does_in_a_ranked_episode_changes_no_answer_to_anybody_else(open_study):
    """The operator, too, gets the same after one move and after three episodes."""
    server, person, clients = open_study
    person.play(moves=1)
    first = answers(server, person, clients)
    person.play()
    person.call("next")
    person.play(moves=3)
    changed = {
        key: text for key, text in answers(server, person, clients).items() if text != first[key]
    }
    assert changed == {}
    assert len(first) > 150


def test_no_socket_shows_a_ranked_episode_of_an_open_study_to_anybody_else(open_study):
    server, person, clients = open_study
    session, episode = person.where["session"], person.frame["episode"]
    with ExitStack() as stack:
        for who, client in clients.items():
            for path in ("/ws/sessions/", "/ws/watch/"):
                socket = stack.enter_context(
                    server.socket(session if "sessions" in path else episode, client, path=path)
                )
                assert socket.receive()["kind"] == "error", (who, path)
            check_that_the_view_is_unknown(server, session, client)
        watching = stack.enter_context(
            server.socket(session, clients["operator"], path="/ws/admin/sessions/")
        )
        person.play(moves=3)
        with pytest.raises(TimeoutError):
            watching.connection.recv(timeout=1)
        act = {"episode": episode, "step": 3, "action": "south"}
        assert clients["operator"].post(f"/api/sessions/{session}/act", json=act).status_code == 404


def test_the_operator_watches_the_warm_up_until_the_first_ranked_episode(open_study):
    server, _, clients = open_study

    def listed():
        boards = clients["operator"].get("/api/admin/overview").json()["boards"]
        return [board["session"] for board in boards]

    person = Person(server)
    person.to_warm_up()
    person.call("next")
    session, path = person.where["session"], "/ws/admin/sessions/"
    with server.socket(session, clients["operator"], path=path) as watching, person.socket():
        assert watching.receive("frame")["episode"] == person.frame["episode"]
        assert session in listed()
        person.play_on(until=("ranked",))
        person.call("next")
        person.play(moves=2)
        seen = []
        with suppress(TimeoutError):
            while True:
                seen.append(watching.receive("frame", seconds=1)["episode"])
        assert seen
        assert person.frame["episode"] not in seen
        assert session not in listed()


READING = (
    "export --out {out}/all",
    "report --study small --json {out}/report.json --no-policies",
    "study show small",
    "study list",
    "study invite small --list",
    "study preregister small --out {out}/text.md",
    "study power small --pilot small",
    "costs --study small --json {out}/costs.json",
    "verify",
)
"""Commands that read a database, with what they are asked for."""
NOT_OF_EPISODES = r"^chain: .*\n|[\d,]+ episodes simulated.*|\"made_at\": .*"
"""What a command says of the moment, and how many episodes of all kinds a database holds."""


def test_no_command_tells_the_operator_anything_of_a_ranked_episode(open_study, capsys, tmp_path):
    """What they print and write is the same after one ranked episode and after two."""
    server, person, _ = open_study
    person.play()
    outputs = [printed(capsys, server, tmp_path / "first")]
    person.call("next")
    person.play(moves=3)
    outputs.append(printed(capsys, server, tmp_path / "second"))
    assert outputs[0] == outputs[1]
    refused = outputs[0]["study power small --pilot small"][0]
    assert "shows no figure until it is closed" in refused
    assert (
        "left out, since they are open: small (--open-studies"
        in outputs[0]["export --out {out}/all"][0]
    )


def printed(capsys, server, out):
    """What each command prints and writes to files, without times and whole counts."""
    out.mkdir()
    outputs = {}
    for words in READING:
        database = "--database", server.services.store.path
        _, text, error = command(capsys, *words.format(out=out).split(), *database)
        files = [re.sub(NOT_OF_EPISODES, "", path.read_text()) for path in sorted(out.rglob("*.*"))]
        spoken = re.sub(NOT_OF_EPISODES, "", text + error, flags=re.M).replace(str(out), "OUT")
        outputs[words] = spoken, files
    return outputs


def test_an_export_of_an_open_study_is_asked_for_and_stands_in_the_chain_and_the_report(
    open_study, capsys, tmp_path
):
    server, person, _ = open_study
    person.play_on()
    path = server.services.store.path
    export = partial(command, capsys, "export", "--database", path)
    code, out, error = export("--out", tmp_path / "all", "--open-studies")
    assert (code, error) == (0, "")
    assert "taken in although open, which the chain and their reports say: small" in out
    assert person.frame["episode"] in (tmp_path / "all/episodes.csv").read_text()
    assert command(capsys, "study", "close", "small", "--yes", "--now", "--database", path)[0] == 0
    assert verify_database(path).findings == ()
    data = load(path, "small")
    assert len(data.exports_ms) == 1
    day = datetime.now(UTC).date().isoformat()
    sentence = f"Its episodes were exported while it was open, on {day}"
    assert [caution for caution in cautions(data, build(data).groups[0]) if sentence in caution]
