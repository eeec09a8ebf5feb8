"""Only cookies of this server reach what reads them: Python takes seconds for a long one between quotation marks."""

import time

import pytest
from starlette.requests import Request

from app.protection import OwnCookies
from tests.support.servers import eventually

ESCAPES = '"' + "\\a" * 7500 + '"'
"""15 KB that take 0.3 s, and four times as long with each doubling."""


def handed_on(*cookies):
    """The cookies that a handler finds, where these headers came."""
    found = []

    async def handler(scope, receive, send):
        found.append(Request(scope).cookies)

    headers = [(b"accept", b"*/*"), *((b"cookie", each.encode()) for each in cookies)]
    call = OwnCookies(handler, ("mars_player", "mars_admin"))(
        {"type": "http", "headers": headers}, None, None
    )
    with pytest.raises(StopIteration):
        call.send(None)
    return found[0]


def test_our_cookies_are_handed_on_and_no_others():
    assert handed_on() == {}
    assert handed_on("other=1") == {}
    assert handed_on("other=1; mars_player=a.b-c_d; mars_players=2; mars_admin=x:y:1.z") == {
        "mars_player": "a.b-c_d",
        "mars_admin": "x:y:1.z",
    }
    assert handed_on("other=1; mars_player=a", "mars_admin=b; third") == {
        "mars_player": "a",
        "mars_admin": "b",
    }


@pytest.mark.parametrize("value", ["", ESCAPES, '"a"', "a\\054b", "a b", "a" * 1025])
def test_a_value_that_this_server_never_sets_is_none(value):
    assert handed_on(f"mars_player={value}; mars_admin=b") == {"mars_admin": "b"}


@pytest.mark.parametrize("name", ["mars_player", "other"])
@pytest.mark.parametrize(
    ("method", "path"),
    [("GET", "/api/levels"), ("POST", "/api/sessions"), ("GET", "/api/me/session")],
)
def test_a_long_cookie_keeps_nobody_waiting(server, name, method, path):
    """Forty of these kept everybody waiting for ten seconds and more."""
    client = server.client()
    client.get("/api/levels").raise_for_status()
    began = time.process_time()
    for _ in range(40):
        answer = client.request(
            method,
            path,
            headers={"Cookie": f"{name}={ESCAPES}"},
            json={} if method == "POST" else None,
        )
        assert answer.status_code < 300
        client.cookies.clear()
    assert time.process_time() - began < 4


def test_a_socket_with_a_long_cookie_opens_at_once(server):
    session = server.client().post("/api/sessions", json={"size": 9}).json()["session"]
    began = time.process_time()
    for _ in range(30):
        with server.socket(session, Cookie='mars_player="' + "\\a" * 4000 + '"') as socket:
            socket.receive("frame")
    eventually(lambda: server.services.protection.sockets.open == 0)
    assert time.process_time() - began < 2
