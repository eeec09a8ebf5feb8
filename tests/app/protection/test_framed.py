"""A site that may frame the pages: named by the operator, and no other."""

import pytest
from pydantic import ValidationError

from humanplay.web.settings import Settings

SITE = "https://survey.example"


def test_nobody_frames_the_pages_unless_named(serve):
    policy = serve().client().get("/").headers["content-security-policy"]
    assert "frame-ancestors 'self';" in policy


def test_one_site_that_is_named_frames_the_pages_but_not_the_operators(serve):
    client = serve(framed_by=SITE).client()
    for path in ("/", "/me", "/healthz"):
        policy = client.get(path).headers["content-security-policy"]
        assert f"frame-ancestors 'self' {SITE};" in policy


def test_the_operators_page_is_framed_by_nobody(serve):
    client = serve(framed_by=SITE, admin_password="correct horse battery staple").client()
    assert "frame-ancestors 'none'" in client.get("/admin").headers["content-security-policy"]


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
