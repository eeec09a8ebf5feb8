"""The files of the pages are asked for once, and an edit is seen at once."""

import json
import os
import re

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from humanplay.web.files import PageFiles, router

OLD = "/static/000000000000/"
"""Below a hash that is no more."""
LASTING = "public, max-age=31536000, immutable"


@pytest.fixture
def app(tmp_path):
    (tmp_path / "board.js").write_text("draw(1)")
    app = FastAPI()
    app.include_router(router)
    app.state.files = PageFiles({"": tmp_path})
    return app


@pytest.fixture
def client(app):
    with TestClient(app) as client:
        yield client


def test_a_file_below_its_hash_is_asked_for_once(app, client):
    answer = client.get(f"/{app.state.files.address()}board.js")
    assert (answer.text, answer.headers["cache-control"]) == ("draw(1)", LASTING)
    assert app.state.files.address() == app.state.files.address()


def test_an_edit_changes_the_hash_and_an_old_hash_answers_todays_file(app, client, tmp_path):
    before = app.state.files.address()
    etag = client.get(f"/{before}board.js").headers["etag"]
    (tmp_path / "board.js").write_text("draw(22)")
    for _ in range(2):  # before the next page, and after it
        old = client.get(f"/{before}board.js", headers={"If-None-Match": etag})
        assert (old.status_code, old.text) == (200, "draw(22)")
        assert old.headers["cache-control"] == "no-cache"
        after = app.state.files.address()
        assert after != before
    new = client.get(f"/{after}board.js")
    assert (new.text, new.headers["cache-control"]) == ("draw(22)", LASTING)
    (tmp_path / "other.js").write_text("")
    assert app.state.files.address() != after, "a new file changes the hash"
    (tmp_path / "board.js").unlink()
    assert client.get(f"/{after}board.js").status_code == 404


def test_a_file_is_read_once_while_it_stays_as_it_is(client, tmp_path):
    first, file = client.get(f"{OLD}board.js"), tmp_path / "board.js"
    before = file.stat()
    with file.open("r+") as same:
        same.write("draw(2)")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    again = client.get(f"{OLD}board.js")
    assert again.text == first.text == "draw(1)"
    assert again.headers == first.headers


def test_a_sheet_comes_with_those_that_it_imports(app, client, tmp_path):
    (tmp_path / "common").mkdir()
    (tmp_path / "page").mkdir()
    (tmp_path / "common/base.css").write_text("a { top: 0; }\n")
    (tmp_path / "page/own.css").write_text("b { top: 0; }\n")
    (tmp_path / "page/index.css").write_text('@import "../common/base.css";\n@import "own.css";\n')
    page = f"/{app.state.files.address()}page/index.css"
    assert client.get(page).text == "a { top: 0; }\nb { top: 0; }\n"
    (tmp_path / "common/base.css").write_text("a { top: 1px; }\n")
    edited = client.get(page)
    assert (edited.text[:15], edited.headers["cache-control"]) == ("a { top: 1px; }", "no-cache")


def test_versions_and_methods_are_answered(client):
    whole = client.get(f"{OLD}board.js")
    for version in (whole.headers["etag"], f'"other", W/{whole.headers["etag"]}'):
        same = client.get(f"{OLD}board.js", headers={"If-None-Match": version})
        assert (same.status_code, same.content) == (304, b"")
    assert client.post(f"{OLD}board.js").status_code == 405


def test_a_text_comes_gzipped_to_whoever_reads_that(client, tmp_path):
    text = "draw(1); " * 200
    (tmp_path / "long.js").write_text(text)
    for _ in range(2):
        answer = client.get(f"{OLD}long.js")
        assert (answer.text, answer.headers["content-encoding"]) == (text, "gzip")
        assert int(answer.headers["content-length"]) < len(text) / 10
        same = client.get(f"{OLD}long.js", headers={"If-None-Match": answer.headers["etag"]})
        assert same.status_code == 304
        plain = client.get(f"{OLD}long.js", headers={"Accept-Encoding": "identity"})
        assert (plain.text, plain.headers.get("content-encoding")) == (text, None)
        assert plain.headers["vary"] == answer.headers["vary"] == "Accept-Encoding"


def test_there_is_no_way_out_of_the_folder_and_no_file_without_a_hash(client, tmp_path):
    (tmp_path / "page.html").write_text("{{ a template }}")
    for path in (
        f"{OLD}%2e%2e/{tmp_path.name}/board.js",
        f"{OLD}{'%2e%2e/' * 40}{str(tmp_path)[1:]}/board.js",
        f"{OLD}x/%2e%2e/board.js",
        f"{OLD}page.html",
        f"{OLD}none.js",
        "/static/board.js",
        "/static/common/board.js",
    ):
        assert client.get(path).status_code == 404, path


def test_a_page_names_files_that_last_and_comes_with_what_it_would_ask_for_first(server):
    client = server.client()
    page = client.get("/").text
    files = re.findall(r'(?:href|src)="(static/[^"]+)"', page)
    assert len(files) > 20
    for file in files:
        assert client.get(f"/{file}").headers["cache-control"] == LASTING, file
    answers = json.loads(re.search(r'id="answers">(.*?)</script>', page)[1])
    assert sorted(answers) == ["levels", "maps", "me/session", "policies", "task"]
    for name, answer in answers.items():
        assert client.get(f"/api/{name}").json() == answer
