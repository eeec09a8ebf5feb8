"""The server answers under its own names, and trusts named proxies alone."""

import socket

import pytest
from websockets.exceptions import InvalidStatus

from humanplay.web.operator.login import MOST_ATTEMPTS
from humanplay.web.settings import Settings
from tests.support.command import command

OWN = (
    "127.0.0.1", "127.0.0.1:9000", "[::1]:8000", "[2001:db8::7]", "10.1.2.3", "localhost:8000", "play.localhost",
    "LOCALHOST.", "",
)  # fmt: skip
FOREIGN = (
    "evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "evil.example:8000", "[", "a b", "@",
    "1.2.3.4@evil", "[::1",
)  # fmt: skip


PUBLIC = ("mars.example", "MARS.example:8443")
MACHINE = socket.gethostname()


def test_the_servers_own_names_are_served(serve):
    client = serve(public_url="https://mars.example/lab").client()
    for host in (*OWN, *PUBLIC, MACHINE, MACHINE.split(".")[0] + ".local:80"):
        assert client.get("/api/health", headers={"Host": host}).status_code == 200, host


def test_any_other_host_is_refused_in_words_on_every_path_and_socket(server):
    client = server.client()
    for host in (*FOREIGN, *PUBLIC):
        for path in ("/", "/api/health", "/static/000000000000/common/bar.css"):
            answer = client.get(path, headers={"Host": host})
            assert answer.status_code == 400, host
            assert "--public-url" in answer.json()["detail"]
        forwarded = client.get("/api/health", headers={"X-Forwarded-Host": host})
        assert forwarded.status_code == 400, host
    rebound = {"Host": "evil.example", "Origin": "http://evil.example"}  # a name that was led here
    assert client.post("/api/sessions", headers=rebound).status_code == 400
    page = client.get("/", headers={"Host": "evil.example", "Accept": "text/html"})
    assert (page.status_code, "text/html" in page.headers["content-type"]) == (400, True)
    assert "default-src 'self'" in page.headers["content-security-policy"]
    opened = server.socket("any", **{"X-Forwarded-Host": "evil.example"})
    with pytest.raises(InvalidStatus) as caught, opened:
        pass
    assert caught.value.response.status_code == 400


ONE_TOO_MANY = [401] * MOST_ATTEMPTS + [429]


def guess(client, address):
    headers, wrong = {"X-Forwarded-For": address}, {"password": "wrong-wrong"}
    return client.post("/api/admin/login", json=wrong, headers=headers).status_code


def test_wrong_guesses_cannot_be_spread_over_invented_addresses(serve):
    """Without a named proxy the header counts for nothing; behind one, its left part."""
    client = serve(admin_password="correct-horse").page()
    codes = [guess(client, f"9.9.9.{number}") for number in range(MOST_ATTEMPTS + 1)]
    assert codes == ONE_TOO_MANY


def test_behind_a_named_proxy_each_visitor_is_counted_alone(serve):
    proxies = ["127.0.0.0/8", "10.0.0.7"]
    client = serve(admin_password="correct-horse", trusted_proxies=proxies).page()
    numbers = range(MOST_ATTEMPTS + 1)
    codes = [guess(client, f"9.9.9.{number}, 5.6.7.8, 10.0.0.7") for number in numbers]
    assert codes == ONE_TOO_MANY
    assert guess(client, "5.6.7.9") == 401
    codes = [guess(client, f"2001:db8:1:2:{number}::1") for number in numbers]
    assert codes == ONE_TOO_MANY, "a home changes its address within its /64 as it likes"
    assert guess(client, "2001:db8:1:3::9") == 401


def cookie_of(client, **headers):
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return client.post("/api/sessions", headers=named).headers["set-cookie"]


def test_scheme_and_host_come_from_named_proxies_alone(serve, tmp_path):
    behind = {"trusted_proxies": ["127.0.0.1"], "public_url": "http://mars.example"}
    plain, named = serve(), serve(database=tmp_path / "second.db", **behind)
    assert "Secure" not in cookie_of(plain.page(), X_Forwarded_Proto="https")
    assert "Secure" in cookie_of(named.page(), X_Forwarded_Proto="https")
    behind = {"Origin": "http://mars.example", "X-Forwarded-Host": "mars.example"}
    assert plain.client().post("/api/sessions", headers=behind).status_code == 400
    assert named.client().post("/api/sessions", headers=behind).status_code == 201


def test_the_public_address_says_that_visitors_come_by_tls(serve):
    client = serve(public_url="https://mars.example").client()
    assert "Secure" in cookie_of(client, Host="mars.example")
    assert "Secure" not in cookie_of(client)


def test_settings_that_name_no_address_are_refused_in_words(capsys):
    for flags, sentence in (
        (["--public-url", "mars.example"], "expected the address of the pages"),
        (["--public-url", "https://a:b@mars.example"], "expected the address of the pages"),
        (["--public-url", "https://[mars"], "expected the address of the pages"),
        (["--trusted-proxy", "proxy.example"], "expected an IP address or a network"),
        (["--trusted-proxy", "0.0.0.0/0"], "expected the proxy's own address or network"),
        (["--trusted-proxy", "*"], "expected an IP address or a network"),
    ):
        code, _, errors = command(capsys, "serve", *flags)
        assert (code, sentence in errors) == (2, True)
    settings = Settings(public_url="https://mars.example:443/lab/", trusted_proxies=["10.1.2.3/8"])
    assert settings.public_url == "https://mars.example/lab"
    assert settings.trusted_proxies == ("10.0.0.0/8",)


def test_a_request_that_names_thousands_of_hosts_is_refused_at_the_eleventh(server):
    """Each takes some microseconds, before any rate is counted."""
    client = server.client()
    for count, status in ((10, 200), (11, 400), (2000, 400)):
        hosts = ",".join(["192.0.2.1"] * (count - 1))
        answer = client.get("/healthz", headers={"X-Forwarded-Host": hosts[:16_000]})
        assert answer.status_code == status
