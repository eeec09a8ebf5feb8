"""The server says what a board's episode is, and a challenge stays one."""

from contextlib import closing

import pytest

from humanplay.board.sources import Sources
from humanplay.db import names
from humanplay.db.erasure import forget_player
from humanplay.db.merging import merge
from humanplay.db.store import Store
from marsexplorer.config import EnvConfig
from tests.support.recorded import NOW, ask, play

SMALL = {"size": [9, 12]}
KINDS = [
    (SMALL, "ranked", True),
    (SMALL | {"rival": "frontier-cost"}, "practice", False),
    (SMALL | {"seed": 7}, "practice", False),
    ({"player": "random", "rival": "frontier-cost"}, "watch", False),
]


@pytest.fixture
def against(tmp_path):
    """A finished episode of a player called Ada."""
    with closing(Store(tmp_path / "playground.db")) as store:
        row = play(store, 4, "ada", explore=True, config=EnvConfig.of("random", (9, 12)))
        with store.transaction():
            names.set_name(store.connection, "ada", "Ada", "ada", NOW)
    return row.id


def test_a_session_says_what_it_is(server):
    client = server.page()
    for body, kind, counts in KINDS:
        about = client.post("/api/sessions", json=body).json()
        assert (about["kind"], about["challenges"], about["counts"]) == (kind, None, counts)
        again = client.get(f"/api/sessions/{about['session']}/about").json()
        assert (again["kind"], again["counts"]) == (kind, counts)
    script = server.client().post("/api/sessions", json=SMALL).json()
    assert (script["kind"], script["counts"]) == ("practice", False)
    daily = client.post("/api/daily").json()
    assert (daily["kind"], daily["counts"]) == ("daily", False)


def test_a_terrain_that_was_met_before_never_counts_for_a_moment(serve):
    client = serve(Sources(seed=lambda: 7)).page()
    first = client.post("/api/sessions", json=SMALL | {"seed": 7}).json()
    again = client.post("/api/sessions", json=SMALL).json()
    assert (first["kind"], again["kind"], again["counts"]) == ("practice", "ranked", False)


def test_a_challenge_is_one_terrain_against_one_episode(against, serve):
    first = serve()
    client = first.page()
    about = client.post("/api/sessions", json={"challenges": against}).json()
    challenge = ("challenge", against, False, None)
    stated = [about[name] for name in ("kind", "challenges", "counts", "rival")]
    assert tuple(stated) == challenge
    rival_episode = client.get(f"/api/episodes/{against}").json()
    assert (about["size"], about["frame"]["position"]) == ([9, 12], rival_episode["start"])
    following = client.post(f"/api/sessions/{about['session']}/episodes", json={})
    assert following.status_code == 409
    assert "POST /api/sessions begins another" in following.json()["detail"]
    # another board, of the player's own, and the challenge is still the challenge on another server
    first.stop()
    client = serve().page(cookies=client.cookies)
    again = client.get(f"/api/sessions/{about['session']}/about").json()
    assert tuple(again[name] for name in ("kind", "challenges", "counts", "rival")) == challenge
    assert client.get("/api/me/session").json()["session"] == about["session"]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ({"challenges": "0123456789abcdef"}, "no finished episode"),
        ({"rival": "frontier-cost"}, "leave out player, rival and replays"),
        ({"player": "random"}, "leave out player, rival and replays"),
        ({"seed": 3}, "name no other"),
        ({"size": 9}, "name no other"),
    ],
)
def test_a_challenge_that_cannot_be_is_refused(against, serve, body, reason):
    answer = serve().page().post("/api/sessions", json={"challenges": against} | body)
    assert answer.status_code == 422
    assert reason in str(answer.json()["detail"])


def test_nothing_names_an_episode_that_was_erased(against, serve, tmp_path):
    server = serve()
    about = server.page().post("/api/sessions", json={"challenges": against}).json()
    server.stop()
    database, together = tmp_path / "playground.db", tmp_path / "together.db"
    merge([database], together)
    sql = "SELECT challenges FROM sessions WHERE id = ?"
    assert ask(together, sql, about["session"]) == [(against,)]
    forget_player(database, "Ada")
    assert ask(database, sql, about["session"]) == [(None,)]
