"""Only this server's cookies are parsed: Python takes seconds for a long one."""

import time

import pytest
from starlette.requests import Request

from humanplay.web.protection.gate import with_own_cookies

ESCAPES = '"' + "\\a" * 7500 + '"'
"""15 KB that take 0.3 s, and four times as long with each doubling."""


def handed_on(*cookies):
    """The cookies that a handler finds, where these headers came."""
    headers = [(b"accept", b"*/*"), *((b"cookie", cookie.encode()) for cookie in cookies)]
    names = frozenset((b"humanplay_player", b"humanplay_admin"))
    return Request(with_own_cookies({"type": "http", "headers": headers}, names)).cookies


def test_our_cookies_are_handed_on_and_no_others():
    assert handed_on() == {}
    assert handed_on("other=1") == {}
    cookies = handed_on(
        "other=1; humanplay_player=a.b-c_d; humanplay_players=2; humanplay_admin=x:y:1.z"
    )
    assert cookies == {"humanplay_player": "a.b-c_d", "humanplay_admin": "x:y:1.z"}
    cookies = handed_on("other=1; humanplay_player=a", "humanplay_admin=b; third")
    assert cookies == {"humanplay_player": "a", "humanplay_admin": "b"}


@pytest.mark.parametrize("value", ["", ESCAPES, '"a"', "a\\054b", "a b", "a" * 1025])
def test_a_value_that_this_server_never_sets_is_none(value):
    assert handed_on(f"humanplay_player={value}; humanplay_admin=b") == {"humanplay_admin": "b"}


@pytest.mark.parametrize("name", ["humanplay_player", "other"])
def test_a_long_cookie_keeps_nobody_waiting(server, name):
    """Forty of these kept everybody waiting for ten seconds and more."""
    client = server.client()
    client.get("/api/levels").raise_for_status()
    began = time.process_time()
    for _ in range(40):
        client.cookies.clear()
        cookie = {"Cookie": f"{name}={ESCAPES}"}
        assert client.post("/api/sessions", headers=cookie, json={}).status_code == 201
    assert time.process_time() - began < 4
