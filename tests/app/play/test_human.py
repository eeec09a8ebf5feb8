"""Human is what comes as trusted events with the session's cookie."""

import pytest

from humanplay.web.access import PLAYER_COOKIE
from tests.support.keyboard import press


def finish(server, begun, client, *acts, **socket):
    """Make moves (direction, input) that end off the grid; return the stored episode."""
    with server.socket(begun["session"], client, **socket) as connection:
        frame = connection.receive("frame")
        ways = {"off": "north", "away": "south", "back": "north"}
        if frame["grid"][1][0] != ".":
            ways = {"off": "north", "away": "east", "back": "west"}
        for direction, device in acts:
            action = ways[direction]
            connection.act(frame, action, input=device)
            frame = connection.frame_after(frame["step"])
    return server.page().get(f"/api/episodes/{frame['episode']}").json()


KEYS = (("away", "key"), ("back", "touch"), ("off", "key"))


def test_keys_and_touches_from_the_page_count(server):
    client = server.page()
    begun = client.post("/api/sessions").json()
    assert begun["counts"] is True
    episode = finish(server, begun, client, *KEYS)
    assert (episode["driver"], episode["counts"], episode["outcome"]) == (
        "human",
        True,
        "out_of_bounds",
    )
    assert [(move["driver"], move["input"]) for move in episode["moves"]] == [
        ("human", "key"),
        ("human", "touch"),
        ("human", "key"),
    ]
    assert (episode["attestation"], episode["attestation_reason"]) == ("attested", None)
    assert client.get(f"/api/sessions/{begun['session']}/about").json()["counts"] is True
    assert client.get("/api/human-level").json()["figures"][0]["episodes"] == 1


def test_a_burst_that_was_typed_before_any_answer_was_on_screen_counts(server):
    client = server.page()
    begun = client.post("/api/sessions").json()
    with server.socket(begun["session"], client) as connection:
        first = connection.receive("frame")
        ways = (
            (("south", "ArrowDown"), ("north", "ArrowUp"))
            if first["grid"][1][0] == "."
            else (("east", "KeyD"), ("west", "KeyA"))
        )
        for step in range(10):  # one more than may wait where a page keeps four presses
            action, code = ways[step % 2]
            server.clock.skipped_ms += 50
            now = server.clock.page_ms()
            press(connection, first["episode"], step, action, code, now, seen=0)
        frame = connection.frame_after(9)
        connection.act(frame, "north", input="key")
        frame = connection.frame_after(frame["step"])
    episode = client.get(f"/api/episodes/{frame['episode']}").json()
    assert (episode["counts"], episode["attestation"], episode["attestation_reason"]) == (
        True,
        "attested",
        None,
    )


@pytest.mark.parametrize(
    ("acts", "level"),
    [((("away", None), *KEYS[1:]), None), ((*KEYS[:2], ("off", None)), "spoilt")],
)
def test_one_move_without_an_event_makes_the_whole_episode_a_scripts(server, acts, level):
    client = server.page()
    begun = client.post("/api/sessions").json()
    episode = finish(server, begun, client, *acts)
    counts = level == "spoilt"
    assert (episode["driver"], episode["attestation"], episode["counts"]) == (
        "script",
        level,
        counts,
    )
    assert client.get(f"/api/sessions/{begun['session']}/about").json()["counts"] is counts


def test_one_move_over_http_makes_the_whole_episode_a_scripts(server):
    client = server.page()
    begun = client.post("/api/sessions").json()
    action = "south" if begun["frame"]["grid"][1][0] == "." else "east"
    body = {"episode": begun["frame"]["episode"], "step": 0, "action": action, "input": "key"}
    client.post(f"/api/sessions/{begun['session']}/act", json=body)
    assert client.get(f"/api/sessions/{begun['session']}/about").json()["counts"] is False
    with server.socket(begun["session"], client) as connection:
        frame = connection.receive("frame")
        while not frame["outcome"]:
            connection.act(frame, "north" if action == "south" else "west", input="key")
            frame = connection.frame_after(frame["step"])
    assert client.get(f"/api/episodes/{frame['episode']}").json()["driver"] == "script"


def test_without_the_pages_origin_even_the_players_own_cookie_is_a_script(server):
    client = server.page()
    begun = client.post("/api/sessions").json()
    assert finish(server, begun, client, *KEYS, origin=None)["driver"] == "script"


def test_a_board_that_a_script_began_never_counts(server):
    client = server.client()
    begun = client.post("/api/sessions").json()
    assert begun["counts"] is False
    episode = finish(server, begun, client, *KEYS)
    assert (episode["driver"], episode["counts"]) == ("script", False)


def test_a_chosen_terrain_or_a_rival_never_counts(server):
    client = server.page()
    for body in ({"seed": 9}, {"rival": "frontier-cost"}):
        begun = client.post("/api/sessions", json=body).json()
        assert begun["counts"] is False
        episode = finish(server, begun, client, *KEYS)
        assert (episode["driver"], episode["counts"]) == ("human", False)


def test_after_a_scripts_episode_the_next_may_count_again(server):
    client = server.page()
    begun = client.post("/api/sessions").json()
    finish(server, begun, client, ("off", None))
    assert client.post(f"/api/sessions/{begun['session']}/episodes").json()["counts"] is True
    assert finish(server, begun, client, *KEYS)["counts"] is True


def test_the_cookie_is_one_players_for_good_and_out_of_reach_of_scripts(server):
    client = server.page()
    first = client.post("/api/sessions")
    assert "HttpOnly" in first.headers["set-cookie"]
    assert "SameSite=lax" in first.headers["set-cookie"]
    assert "Secure" not in first.headers["set-cookie"]
    second = client.post("/api/sessions")
    value = client.cookies[PLAYER_COOKIE]
    assert second.headers["set-cookie"].split(";")[0] == f"{PLAYER_COOKIE}={value}"
    forged = server.client(cookies={PLAYER_COOKIE: "me." + "A" * 27}).post("/api/sessions")
    assert PLAYER_COOKIE + "=me." not in forged.headers["set-cookie"]
