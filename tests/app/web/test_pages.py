"""Pages for browsers, JSON for programs: unknown addresses, methods, faults."""

import re
from urllib.parse import urljoin

from fastapi.routing import APIRoute
from jinja2 import Environment, FileSystemLoader

from humanplay.web import pages
from tests.support.study import freeze

HTML = "text/html; charset=utf-8"
FILES = {"common/icon.svg", "common/theme.js", "common/reading.css"}
"""Of the page of an error."""
BROWSER = {"Accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"}


def test_an_unknown_address_is_a_page_for_a_browser_whose_links_lead_somewhere(serve):
    client = serve().client()
    for path in ("/nowhere", "/nowhere/at/all", "/static/000000000000/none.css", "/viewer/none/"):
        answer = client.get(path, headers=BROWSER)
        assert (answer.status_code, answer.headers["content-type"]) == (404, HTML), path
        assert "There is nothing here" in answer.text
        assert "default-src 'self'" in answer.headers["content-security-policy"]
        addresses = re.findall(r'(?:href|src)="([^"#][^"]*)"', answer.text)
        links = {urljoin(path, address) for address in addresses}
        files = {link for link in links if link.startswith("/static/")}
        assert {"/", "/leaderboard", "/about"} <= links, path
        assert {file.split("/", 3)[3] for file in files} == FILES, path
        assert [client.get(file).status_code for file in files] == [200] * 3


def test_a_program_gets_json_wherever_it_asks(serve):
    client = serve().client()
    asked = (("/nowhere", {}), ("/api/nothing", BROWSER), ("/api/sessions/none", BROWSER))
    for path, headers in asked:
        answer = client.get(path, headers=headers)
        assert (answer.status_code, answer.headers["content-type"]) == (404, "application/json")
        assert answer.json()["detail"]
    assert "nothing answers GET /nowhere" in client.get("/nowhere").json()["detail"]


def test_an_address_is_shown_as_text_and_a_method_that_is_not_taken_says_so(serve):
    client = serve().client()
    answer = client.get("/<script>alert(1)</script>", headers=BROWSER)
    assert answer.status_code == 404
    assert "<script>alert" not in answer.text
    assert "&lt;script&gt;alert" in answer.text
    refused = client.post("/leaderboard", headers=BROWSER)
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET")
    assert "This address is not used that way" in refused.text
    assert "nothing answers POST /leaderboard" in client.post("/leaderboard").json()["detail"]


def test_head_is_answered_wherever_get_is(serve):
    """As uptime checks, link previews and load balancers ask."""
    server = serve()
    client = server.client()
    routes = [route for route in server.app.routes if isinstance(route, APIRoute)]
    paths = {route.path for route in routes if "GET" in route.methods}
    assert {"/", "/healthz", "/me", "/study/{name}", "/api/human-level"} <= paths
    for path in ("/nowhere", "/static/000000000000/play/main.js", *sorted(paths)):
        address = re.sub(r"\{\w+\}", "none", path)
        got, head = client.get(address), client.head(address)
        assert (path, head.status_code) == (path, got.status_code)
        assert head.headers.get("content-type") == got.headers.get("content-type")


def test_behind_a_prefix_the_links_of_an_error_stay_behind_it(serve):
    answer = serve().client().get("/a/b", headers=BROWSER)
    script = re.search(r'src="([^"]+theme.js)"', answer.text)[1]
    assert re.fullmatch(r"/mars/static/\w+/common/theme.js", urljoin("/mars/a/b", script))


def test_a_fault_is_a_page_or_json_and_keeps_its_reason_to_itself(serve, monkeypatch, tmp_path):
    server = serve()
    lost = Environment(loader=FileSystemLoader(tmp_path))  # an installation whose pages are lost
    monkeypatch.setattr(pages, "environment", lost)
    for headers, kind in ((BROWSER, HTML), ({}, "application/json")):
        # after a fault the server closes the connection
        answer = server.client().get("/about", headers=headers)
        assert (answer.status_code, answer.headers["content-type"]) == (500, kind)
        assert "Try again in a moment" in answer.text
        assert str(tmp_path) not in answer.text
        assert "default-src 'self'" in answer.headers["content-security-policy"]


def test_every_page_has_the_same_bar_and_its_files_are_there(server):
    client = server.client()
    for path in ("/", "/about", "/study", "/study/none", "/leaderboard", "/docs"):
        answer = client.get(path, headers=BROWSER)
        assert answer.status_code == 200
        files = re.findall(r'(?:href|src)="([^"]*static/[^"]+)"', answer.text)
        assert files
        assert all(client.get(urljoin(path, file)).status_code == 200 for file in files)
        if path not in ("/", "/study/none"):
            bar = re.search('<nav class="pages site".*?</nav>', answer.text, re.DOTALL)[0]
            links = re.findall(r'<a href="([^"]+)"', bar)
            assert links == ["./", "daily", "puzzles", "leaderboard", "me"], path


def test_the_list_of_studies_says_who_may_join(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", "invited", recruitment="invitation")
    freeze(tmp_path / "playground.db-studies", "anybody", recruitment="open")
    client = serve().client()
    listed = {study["name"]: study for study in client.get("/api/studies").json()}
    assert listed["invited"]["recruitment"] == "invitation"
    shown = {"recruitment": "open", "warm_up": 2, "ranked": 3, "status": "open"}
    assert shown.items() <= listed["anybody"].items()
