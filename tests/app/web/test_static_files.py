"""The files of the pages are kept in memory, and are what stands on the disk."""

import os

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from humanplay.web.pages import PageFiles


@pytest.fixture
def client(tmp_path):
    (tmp_path / "board.js").write_text("draw(1)")
    app = FastAPI()
    app.mount("/static", PageFiles(directory=tmp_path))
    with TestClient(app) as client:
        yield client


def test_a_file_is_read_once_while_it_stays_as_it_is(client, tmp_path):
    first, file = client.get("/static/board.js"), tmp_path / "board.js"
    before = file.stat()
    with file.open("r+") as same:
        same.write("draw(2)")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    again = client.get("/static/board.js")
    assert again.text == first.text == "draw(1)"
    assert again.headers == first.headers
    assert again.headers["cache-control"] == "no-cache"


def test_a_file_that_has_changed_is_read_anew_and_one_that_is_gone_is_not_served(client, tmp_path):
    old = client.get("/static/board.js")
    (tmp_path / "board.js").write_text("draw(22)")
    for _ in range(2):
        changed = client.get("/static/board.js", headers={"If-None-Match": old.headers["etag"]})
        assert (changed.status_code, changed.text) == (200, "draw(22)")
        assert changed.headers["content-length"] == "8"
    (tmp_path / "board.js").unlink()
    assert client.get("/static/board.js").status_code == 404


def test_versions_parts_and_heads_are_answered_from_memory_as_from_the_disk(client):
    for _ in range(2):
        whole = client.get("/static/board.js")
        same = client.get("/static/board.js", headers={"If-None-Match": whole.headers["etag"]})
        assert (same.status_code, same.content) == (304, b"")
        part = client.get("/static/board.js", headers={"Range": "bytes=0-3"})
        assert (part.status_code, part.text) == (206, "draw")
        head = client.head("/static/board.js")
        assert (head.status_code, head.content, head.headers["content-length"]) == (200, b"", "7")
        assert client.post("/static/board.js").status_code == 405
        assert client.get("/static/../static/nothing.js").status_code == 404


def test_a_text_comes_gzipped_to_whoever_reads_that(client, tmp_path):
    text = "draw(1); " * 200
    (tmp_path / "long.js").write_text(text)
    for _ in range(2):
        found = client.get("/static/long.js")
        assert (found.text, found.headers["content-encoding"]) == (text, "gzip")
        assert int(found.headers["content-length"]) < len(text) / 10
        same = client.get("/static/long.js", headers={"If-None-Match": found.headers["etag"]})
        assert same.status_code == 304
        plain = client.get("/static/long.js", headers={"Accept-Encoding": "identity"})
        assert (plain.text, plain.headers.get("content-encoding")) == (text, None)
        assert plain.headers["vary"] == found.headers["vary"] == "Accept-Encoding"


def test_a_file_has_one_name_however_one_goes_out_of_the_folder_and_in_again(client, tmp_path):
    """Else each name would keep the file in memory once more, and say how the folders above are called."""
    assert client.get("/static/folder/%2e%2e/board.js").text == "draw(1)"
    for up in (
        f"%2e%2e/{tmp_path.name}",
        f"{'%2e%2e/' * 40}{str(tmp_path)[1:]}",
        f"x/%2e%2e/%2e%2e/{tmp_path.name}",
    ):
        assert client.get(f"/static/{up}/board.js").status_code == 404
