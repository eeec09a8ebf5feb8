"""Nothing is changed for another site's page, whatever route or socket it tries."""

import re

import pytest
from fastapi.routing import APIRoute
from starlette.routing import Route, WebSocketRoute
from websockets.exceptions import InvalidStatus

from humanplay.web.protection.gate import SAFE_METHODS
from tests.support.study import freeze

FOREIGN = "https://evil.example"
MALFORMED = (
    "http://[", "http://[::1", "http://a:b", "http://a:99999", "evil", "//evil", "http://a/b", "null null", "http://a b", "",
)  # fmt: skip


SITES = (
    ("Origin", FOREIGN), ("Origin", "null"), ("Sec-Fetch-Site", "cross-site"), ("Sec-Fetch-Site", "same-site"),
)  # fmt: skip


@pytest.fixture
def operated(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    return serve(admin_password="correct-horse")


def changing_calls(app):
    """Yield method and path of each route that may change something.

    Its parameters are filled in.
    """
    for route in app.routes:
        if isinstance(route, Route | APIRoute):
            path = re.sub(r"\{[^}]*\}", "any", route.path)
            yield from ((method, path) for method in sorted(route.methods - set(SAFE_METHODS)))
        else:
            assert isinstance(route, WebSocketRoute), route


def test_every_route_that_changes_something_refuses_another_sites_page(operated):
    client, calls = operated.client(), list(changing_calls(operated.app))
    assert len(calls) > 20
    for method, path in calls:
        for name, value in SITES:
            answer = client.request(method, path, headers={name: value})
            assert answer.status_code == 403, (method, path, value)
            reason = "must come from a page of this server or from a script"
            assert reason in answer.json()["detail"]
    assert len(operated.services.lobby) == 0


def test_every_socket_refuses_another_sites_page_before_it_opens(operated):
    sockets = [route for route in operated.app.routes if isinstance(route, WebSocketRoute)]
    assert len(sockets) >= 4
    for path in (re.sub(r"\{[^}]*\}", "", route.path) for route in sockets):
        for origin in (FOREIGN, "null", "http://["):
            opened = operated.socket("any", origin=origin, path=path)
            with pytest.raises(InvalidStatus) as caught, opened:
                pass
            assert caught.value.response.status_code == 403


def test_a_malformed_origin_is_a_refusal_in_words(server):
    client = server.client()
    for origin in MALFORMED:
        for method, path in (("GET", "/"), ("GET", "/api/health"), ("POST", "/api/sessions")):
            answer = client.request(method, path, headers={"Origin": origin})
            assert answer.status_code == 403, origin
            assert "must be null or scheme://host" in answer.json()["detail"]
    twice = server.client(headers=[("Origin", server.url), ("Origin", FOREIGN)])
    assert twice.post("/api/sessions").status_code == 403


def test_own_pages_and_scripts_are_welcome_and_anybody_may_read(serve):
    server = serve(public_url="https://mars.example")
    for headers in (
        {},
        {"Origin": server.url},
        {"Origin": server.url, "Sec-Fetch-Site": "same-origin"},
        {"Sec-Fetch-Site": "none"},
        {"Origin": "https://mars.example"},
        {"Origin": "https://mars.example", "Host": "mars.example"},
    ):
        assert server.client().post("/api/sessions", headers=headers).status_code == 201, headers
    assert server.client().get("/api/levels", headers={"Origin": FOREIGN}).status_code == 200
    near = ("http://mars.example", "https://mars.example:444", "ftp://mars.example")
    for wrong in (*near, "https://mars.example.evil.example"):
        refused = server.client().post("/api/sessions", headers={"Origin": wrong})
        assert refused.status_code == 403, wrong
