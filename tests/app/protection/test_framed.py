"""A site that may frame the pages: named by the operator, and no other."""

import re

import pytest
from pydantic import ValidationError

from humanplay.web.settings import Settings

SITE = "https://survey.example"
PATHS = ("/", "/me", "/healthz", "/viewer/client/")


def ancestors(answer):
    """Who may frame a page, as its policy says."""
    policy = answer.headers["content-security-policy"]
    return re.search(r"frame-ancestors ([^;]*)", policy)[1]


def test_the_server_alone_frames_its_pages_unless_a_site_is_named(serve):
    client = serve().client()
    for path in PATHS:
        assert ancestors(client.get(path)) == "'self'"


def test_one_site_that_is_named_frames_the_pages_but_not_the_operators(serve):
    client = serve(framed_by=SITE).client()
    for path in PATHS:
        assert ancestors(client.get(path)) == f"'self' {SITE}"


def test_the_operators_page_is_framed_by_nobody(serve):
    client = serve(framed_by=SITE, admin_password="correct horse battery staple").client()
    assert ancestors(client.get("/admin")) == "'none'"


@pytest.mark.parametrize("framed_by", [None, SITE])
def test_cookies_reach_a_frame_of_another_site_alone_where_one_is_named(serve, framed_by):
    answer = serve(framed_by=framed_by).client().post("/api/sessions", json={})
    cookie = answer.headers["set-cookie"]
    is_framed = framed_by is not None
    assert ("samesite=none" in cookie.lower()) is is_framed
    assert cookie.endswith("; Partitioned") is is_framed
    assert ("Secure" in cookie) is is_framed


@pytest.mark.parametrize(
    "site", ["survey.example", "https://survey.example/page", "https://a b", "*"]
)
def test_a_site_is_an_address_without_a_path(site):
    with pytest.raises(ValidationError, match="expected"):
        Settings(framed_by=site)
