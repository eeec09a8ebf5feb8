"""Every answer's headers guide the browser; what is private is stored nowhere."""

import re

import pytest
from fastapi.routing import APIRoute
from starlette.routing import Route

from humanplay.board.messages import MAX_MESSAGE_BYTES
from tests.support.study import freeze

SAME_FOR_ALL = {
    "/", "/study/{name}", "/leaderboard", "/about", "/study", "/daily", "/me", "/docs", "/evaluations", "/play",
    "/puzzles", "/favicon.ico", "/apple-touch-icon.png", "/robots.txt",
}  # fmt: skip
"""Pages that are the same for everybody: what is on them comes over the API. All other answers are stored nowhere."""
VIEWER = {"/viewer/client/", "/viewer/client/{version}/", "/viewer/{session_id}/"}


@pytest.fixture
def site(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", "small")
    return serve(admin_password="correct-horse", public_url="https://mars.example")


def test_every_answer_but_pages_that_are_the_same_for_all_is_stored_nowhere(site):
    client = site.page()
    mine = client.post("/api/sessions").json()
    values = {
        "session_id": mine["session"],
        "watch_id": mine["watch"],
        "name": "small",
        "table": "episodes",
    }
    routes = [route for route in site.app.routes if isinstance(route, Route | APIRoute)]
    paths = [route.path for route in routes if "GET" in route.methods]
    assert set(paths) > SAME_FOR_ALL
    for path in paths:
        asked = re.sub(r"\{(\w+)[^}]*\}", lambda match: values.get(match[1], "any"), path)
        answer = client.get(asked, follow_redirects=False)
        expected = "no-cache" if path in SAME_FOR_ALL or path == "/watch/{watch_id}" else "no-store"
        if path not in VIEWER:
            assert answer.headers["cache-control"] == expected, (path, answer.status_code)
    for asked in ("/static/000000000000/common/bar.css", "/static/000000000000/common/messages.js"):
        answer = client.get(asked)
        again = client.get(asked, headers={"If-None-Match": answer.headers["etag"]})
        assert again.status_code == 304
        assert answer.headers["cache-control"] == again.headers["cache-control"] == "no-cache"


def test_every_answer_has_the_headers_refusals_included(site):
    client = site.client()
    paths = (
        "/",
        "/api/health",
        "/nowhere",
        "/static/000000000000/common/bar.css",
        "/api/me/history",
    )
    answers = [client.get(path) for path in paths]
    answers += [client.post("/api/sessions", content=b" " * (MAX_MESSAGE_BYTES + 1))]
    answers += [client.post("/api/sessions", headers={"Origin": "https://evil.example"})]
    answers += [client.get("/", headers={"Host": "evil.example"})]
    assert [answer.status_code for answer in answers] == [200, 200, 404, 200, 200, 413, 403, 400]
    for answer in answers:
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert "camera=(), microphone=(), geolocation=()" in answer.headers["permissions-policy"]
        assert "default-src 'self'" in answer.headers["content-security-policy"]


def test_what_browsers_heed_by_tls_alone_is_sent_by_tls_alone(site):
    client = site.client()
    tls, loopback, lan = (
        client.get("/", headers={"Host": host}).headers
        for host in ("mars.example", "localhost", "10.1.2.3")
    )
    assert "max-age=31536000" in tls["strict-transport-security"]
    assert "strict-transport-security" not in loopback
    assert "strict-transport-security" not in lan
    opener = "cross-origin-opener-policy"
    assert [headers.get(opener) for headers in (tls, loopback, lan)] == [
        "same-origin",
        "same-origin",
        None,
    ]


def test_the_3d_client_runs_its_own_scripts_alone(site):
    client = site.page()
    session = client.post("/api/sessions").json()["session"]
    policy = client.get(f"/viewer/{session}/").headers["content-security-policy"]
    scripts = re.search("script-src ([^;]*)", policy)[1]
    assert scripts.count("'sha256-") == 3
    assert "unsafe-inline" not in scripts
