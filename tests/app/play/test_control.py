"""A page's board obeys its player's cookie; a script's obeys whoever has its id."""

import json

import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.board.sources import WatchIds
from humanplay.web.access import PLAYER_COOKIE
from tests.support.servers import eventually, forged
from tests.support.study import Person, freeze


def askers(server, owner):
    """Everybody but the player: another page, nobody, a forger, a script with the id."""
    other = server.page()
    other.post("/api/sessions", json={"seed": 1})
    forger = server.page(cookies={PLAYER_COOKIE: forged(owner.cookies[PLAYER_COOKIE])})
    return {"another": other, "nobody": server.page(), "forger": forger, "script": server.client()}


def calls(session, frame):
    act = {"episode": frame["episode"], "step": frame["step"], "action": "south"}
    url = f"/api/sessions/{session}"
    return [
        ("GET", url, None), ("GET", f"{url}/about", None), ("GET", f"{url}/history", None), ("POST", f"{url}/act", act),
        ("POST", f"{url}/episodes", {}), ("POST", f"{url}/pace", {"pause": True}), ("GET", f"/viewer/{session}/", None),
        ("POST", "/api/sessions", {"player": "random", "replays": session}),
    ]  # fmt: skip


def closing_code(socket):
    try:
        while True:
            socket.receive()
    except ConnectionClosed as closed:
        return closed.rcvd.code


@pytest.mark.parametrize(
    "body", [{}, {"rival": "frontier-cost"}, {"player": "random", "rival": "frontier-cost"}]
)
def test_a_board_of_the_page_is_unknown_to_everybody_but_its_player(server, body):
    owner = server.page()
    begun = owner.post("/api/sessions", json=body).json()
    ids = [begun["session"], *([begun["rival"]["session"]] if begun["rival"] else [])]
    for who, client in askers(server, owner).items():
        for session in ids:
            for method, url, content in calls(session, begun["frame"]):
                answer = client.request(method, url, json=content)
                unknown_url = (
                    f"/api/sessions/{'x' * 22}" + url.partition(session)[2]
                    if session in url
                    else url
                )
                unknown = client.request(method, unknown_url, json=content)
                assert answer.status_code == 404, (who, method, url)
                if session in url and "viewer" not in url:
                    assert answer.text == unknown.text.replace("x" * 22, session), (
                        "as for an id that does not exist"
                    )
            for path in ("/ws/sessions/", "/viewer/"):
                with server.socket(session, client, path=path) as socket:
                    assert closing_code(socket) == 4404, (who, path)
    store = server.services.store
    assert all(store.resume_session(session).session.control == "cookie" for session in ids)
    about = owner.get(f"/api/sessions/{ids[0]}/about").json()
    assert about["frame"]["episode"] == begun["frame"]["episode"], "nothing has changed"
    with server.socket(ids[0], owner) as socket:
        assert socket.receive("frame")["episode"] == begun["frame"]["episode"]


def test_a_copied_id_cannot_turn_a_ranked_episode_into_a_scripts(server):
    owner, friend = server.page(), server.page()
    friend.post("/api/sessions", json={"seed": 1})
    begun = owner.post("/api/sessions", json={"size": [9, 12]}).json()
    away, back = ("south", "north") if begun["frame"]["grid"][1][0] == "." else ("east", "west")
    with server.socket(begun["session"], owner) as mine:
        frame = mine.receive("frame")
        mine.act(frame, away, input="key")
        frame = mine.frame_after(0)
        with server.socket(begun["session"], friend) as copied:
            assert closing_code(copied) == 4404
        act = {"episode": frame["episode"], "step": 1, "action": back}
        assert friend.post(f"/api/sessions/{begun['session']}/act", json=act).status_code == 404
        for action in (back, "north", "west"):
            mine.act(frame, action, input="key")
            frame = mine.frame_after(frame["step"])
            if frame["outcome"]:
                break
    stored = owner.get(f"/api/episodes/{frame['episode']}").json()
    assert (stored["driver"], stored["counts"]) == ("human", True)


def test_the_operator_watches_a_players_board_on_their_own_page_and_cannot_move_it(serve):
    server = serve(admin_password="correct horse")
    owner, operator = server.page(), server.page()
    assert operator.post("/api/admin/login", json={"password": "correct horse"}).status_code < 300
    begun = owner.post("/api/sessions").json()
    url, frame = f"/api/sessions/{begun['session']}", begun["frame"]
    assert operator.get(url).status_code == 404
    act = {"episode": frame["episode"], "step": 0, "action": "south"}
    assert operator.post(f"{url}/act", json=act).status_code == 404
    assert operator.post(f"{url}/episodes").status_code == 404
    with server.socket(begun["session"], operator) as socket:
        assert socket.receive()["kind"] == "error"
    with server.socket(begun["session"], operator, path="/ws/admin/sessions/") as socket:
        socket.act(socket.receive("frame"), "south", input="key")
    assert owner.get(url).json() == frame


def test_a_board_that_a_script_began_is_moved_by_its_id_as_ever(server):
    begun = server.client().post("/api/sessions", json={"rival": "frontier-cost"}).json()
    frame, other = begun["frame"], server.client()
    act = {
        "episode": frame["episode"],
        "step": 0,
        "action": "south" if frame["grid"][1][0] == "." else "east",
    }
    assert other.post(f"/api/sessions/{begun['session']}/act", json=act).json()["step"] == 1
    assert (
        other.post(f"/api/sessions/{begun['rival']['session']}/pace", json={"pause": True}).json()[
            "mode"
        ]
        == "paused"
    )
    with server.socket(begun["session"], other) as socket:
        assert socket.receive("frame")["step"] == 1
    assert other.post(f"/api/sessions/{begun['session']}/episodes").status_code == 201


def test_the_page_finds_its_own_board_by_its_cookie_alone(server):
    owner, other = server.page(), server.page()
    assert owner.get("/api/me/session").json() is None
    practice = owner.post("/api/sessions", json={"rival": "frontier-cost"}).json()
    assert owner.get("/api/me/session").json()["session"] == practice["session"]
    ranked = owner.post("/api/sessions").json()
    owner.post("/api/sessions", json={"player": "random", "seed": 3})  # a replay, say
    assert owner.get("/api/me/session").json()["session"] == ranked["session"]
    for begun in (practice, ranked):
        board = owner.get(f"/api/me/session?episode={begun['frame']['episode']}").json()
        assert board["session"] == begun["session"]
    rival_page = owner.get(
        f"/api/me/session?episode={practice['rival']['frame']['episode']}"
    ).json()
    assert rival_page["session"] == practice["session"], (
        "a rival's episode is on its player's screen"
    )
    other.post("/api/sessions", json={"seed": 1})
    for client in (other, server.client()):
        assert client.get(f"/api/me/session?episode={ranked['frame']['episode']}").json() is None
    assert owner.get("/api/me/session?episode=none").json() is None


def test_an_episode_can_be_watched_by_its_id_and_the_answers_hold_nothing_else(server):
    owner, spectator = server.page(), server.page()
    begun = owner.post("/api/sessions", json={"size": [9, 12], "rival": "frontier-cost"}).json()
    episode, row = begun["frame"]["episode"], server.services.store.resume_session(begun["session"])
    seen = []
    with (
        server.socket(episode, spectator, path="/ws/watch/") as watching,
        server.socket(begun["session"], owner) as mine,
    ):
        frame = mine.receive("frame")
        assert watching.receive("frame") == frame
        assert watching.receive("history")["positions"] == [[0, 0]]
        away, back = ("south", "north") if frame["grid"][1][0] == "." else ("east", "west")
        for action in (away, back):
            mine.act(frame, action, input="key")
            frame = mine.frame_after(frame["step"])
            seen.append(watching.receive("frame"))
            assert seen[-1] == frame
        watching.act(frame, away, input="key")  # whatever a spectator sends is ignored
        watched = spectator.get(f"/api/watch/{episode}").json()
        assert (watched["frame"], watched["frames"], watched["player"], watched["size"]) == (
            frame,
            None,
            "human",
            [9, 12],
        )
        assert len(watched["history"]["positions"]) == 3
        rival = spectator.get(f"/api/watch/{begun['rival']['frame']['episode']}").json()
        assert rival["player"] == "frontier-cost"
        mine.act(frame, "north", input="key")
        frame = mine.frame_after(2)
        last = watching.receive("frame")
        assert (last["outcome"], last) == ("out_of_bounds", frame)
        assert closing_code(watching) == 1000
    replay = spectator.get(f"/api/watch/{episode}").json()
    assert [recorded["step"] for recorded in replay["frames"]] == [0, 1, 2, 3]
    assert replay["frames"][1:3] == seen
    answers = json.dumps([watched, rival, seen, replay])
    secrets = [
        begun["session"],
        begun["rival"]["session"],
        row.session.player_id,
        str(row.episode.seed),
        row.episode.terrain.hex(),
    ]
    assert not [secret for secret in secrets if secret in answers]
    for method, url, content in calls(episode, begun["frame"]):
        assert spectator.request(method, url, json=content).status_code == 404, (
            "the id grants nothing but watching"
        )
    assert spectator.get(f"/api/me/session?episode={episode}").json() is None


def test_a_board_is_watched_by_an_id_of_its_own_one_episode_after_the_other(server):
    owner, spectator = server.page(), server.page()
    begun = owner.post("/api/sessions", json={"size": [9, 12]}).json()
    session, watch, first = begun["session"], begun["watch"], begun["frame"]
    with (
        server.socket(watch, spectator, path="/ws/watch/") as watching,
        server.socket(session, owner) as mine,
    ):
        assert (watching.receive("frame"), watching.receive("history")["positions"]) == (
            first,
            [[0, 0]],
        )
        mine.act(first, "north", input="key")
        last = mine.frame_after(0)
        assert watching.receive("frame") == last
        assert (last["outcome"], spectator.get(f"/watch/{watch}").status_code) == (
            "out_of_bounds",
            200,
        )
        assert (
            spectator.get(f"/watch/{first['episode']}").headers["location"]
            == f"../replay/{first['episode']}"
        )
        following = owner.post(f"/api/sessions/{session}/episodes").json()
        assert following["watch"] == watch
        assert watching.receive("frame") == following["frame"]
        assert (
            watching.receive("history")["episode"]
            == following["frame"]["episode"]
            != first["episode"]
        )
    watched = spectator.get(f"/api/watch/{watch}").json()
    assert (watched["frame"], watched["frames"]) == (following["frame"], None)
    lists = ("episodes", "export/episodes.csv", "export/steps.csv")
    for url in (
        *lists,
        f"watch/{first['episode']}",
        f"watch/{following['frame']['episode']}",
        f"watch/{watch}",
    ):
        assert watch not in spectator.get(f"/api/{url}").text, url
    for method, url, content in calls(watch, following["frame"]):
        assert spectator.request(method, url, json=content).status_code == 404, (
            "the id grants nothing but watching"
        )
    assert spectator.get(f"/api/me/session?watch={watch}").json() is None
    assert owner.get(f"/api/me/session?watch={watch}").json()["session"] == session
    assert server.on_loop(WatchIds(server.services.store).session(watch)) == session, (
        "a restarted server finds the board"
    )
    assert spectator.post("/api/sessions").json()["watch"] != watch


def test_who_watches_sees_the_end_of_an_episode_that_is_left_and_wakes_nobody(serve, monkeypatch):
    monkeypatch.setattr("humanplay.board.spectators.LOOK_S", 0.05)
    server = serve(idle_s=0.2)
    owner = server.page()
    begun = owner.post(
        "/api/sessions", json={"player": "random", "rival": "frontier-cost", "size": 30}
    ).json()
    owner.post(f"/api/sessions/{begun['session']}/pace", json={"pause": True})
    episode = begun["frame"]["episode"]
    with server.socket(episode, path="/ws/watch/") as watching:
        watching.receive("frame")
        eventually(lambda: len(server.services.lobby) == 0)
        for _ in range(5):
            server.client().get(f"/api/watch/{episode}")
            assert len(server.services.lobby) == 0, (
                "a board that its player has left is not resumed by being watched"
            )
        owner.post(f"/api/sessions/{begun['session']}/episodes")
        frame = watching.receive("frame")
        while not frame["outcome"]:
            frame = watching.receive("frame")
        assert frame["outcome"] == "abandoned"
        assert closing_code(watching) == 1000


def test_what_cannot_be_watched_is_unknown(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    board = person.where["about"]
    assert board["watch"] is None
    for episode in (
        "none",
        board["frame"]["episode"],
        board["session"],
        WatchIds(server.services.store).of(board["session"]),
    ):
        answer = server.page().get(f"/api/watch/{episode}")
        assert (answer.status_code, "that can be watched" in answer.json()["detail"]) == (404, True)
        with server.socket(episode, path="/ws/watch/") as socket:
            assert "that can be watched" in socket.receive("error")["detail"]
            assert closing_code(socket) == 4404
