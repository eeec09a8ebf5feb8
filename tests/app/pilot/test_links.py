"""The links that `play` shows, by where its program and its page are."""

import sys
import threading
import webbrowser
from contextlib import closing
from types import ModuleType, SimpleNamespace

import httpx
import pytest

from humanplay import play
from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.links import show
from tests.support.browser import free_port
from tests.support.command import command
from tests.support.own_environment import Line
from tests.support.servers import PATIENCE_S

LOCAL, SHARED, PUBLIC = "http://127.0.0.1:8123", "http://0.0.0.0:8123", "https://play.example"
FORWARDING = "ssh -N -L 8123:127.0.0.1:8123"


@pytest.fixture
def opened(monkeypatch):
    """The addresses that the browser of this machine was asked for."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    monkeypatch.delenv("SSH_CONNECTION", raising=False)
    monkeypatch.delenv("JUPYTERHUB_SERVICE_PREFIX", raising=False)
    return addresses


@pytest.fixture
def cells(monkeypatch):
    """What a notebook displays."""
    shown = []
    display = ModuleType("IPython.display")
    display.HTML, display.display = str, shown.append
    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object()))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return shown


@pytest.fixture
def in_hub(monkeypatch, tmp_path, opened):
    """A notebook's server of a hub, which passes requests on to ports."""
    (tmp_path / "jupyter_server_proxy.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/ann/")


def show_all(address, **options):
    """Show the links, and wait until the browser was asked."""
    before = set(threading.enumerate())
    show(address, **options)
    for thread in set(threading.enumerate()) - before:
        thread.join(PATIENCE_S)


def over_ssh(monkeypatch):
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.1 50000 10.0.0.2 22")


@pytest.mark.parametrize(
    ("address", "public_url", "is_remote", "link", "tab"),
    [
        pytest.param(LOCAL, None, False, LOCAL, LOCAL, id="local"),
        pytest.param(LOCAL, None, True, LOCAL, None, id="ssh"),
        pytest.param(SHARED, None, False, None, LOCAL, id="shared"),
        pytest.param(SHARED, None, True, None, None, id="shared, ssh"),
        pytest.param(LOCAL, PUBLIC, False, PUBLIC, PUBLIC, id="public"),
        pytest.param(LOCAL, PUBLIC, True, PUBLIC, None, id="public, ssh"),
    ],
)
def test_a_program_prints_one_link_and_opens_it_where_the_browser_is(
    monkeypatch, capsys, opened, address, public_url, is_remote, link, tab
):
    if is_remote:
        over_ssh(monkeypatch)
    show_all(address, public_url=public_url)
    first, *others = capsys.readouterr().out.splitlines()
    if link:
        assert first == f"Play at {link}"
    else:
        assert first.startswith("Play at http://")
        assert first.endswith(":8123")
        assert "0.0.0.0" not in first
    is_forwarded = is_remote and link == LOCAL
    assert [FORWARDING in line for line in others] == [True] * is_forwarded
    assert opened == [tab] * bool(tab)


@pytest.mark.parametrize(
    ("address", "public_url", "is_remote", "has_proxy", "link"),
    [
        pytest.param(LOCAL, None, False, False, LOCAL, id="local"),
        pytest.param(LOCAL, None, True, False, LOCAL, id="ssh"),
        pytest.param(LOCAL, None, True, True, "/proxy/8123/", id="proxy, ssh"),
        pytest.param(SHARED, None, False, True, "/proxy/8123/", id="proxy, shared"),
        pytest.param(LOCAL, PUBLIC, True, True, PUBLIC, id="public"),
    ],
)
def test_a_notebook_shows_one_link(
    monkeypatch, tmp_path, capsys, opened, cells, address, public_url, is_remote, has_proxy, link
):
    if is_remote:
        over_ssh(monkeypatch)
    if has_proxy:
        (tmp_path / "jupyter_server_proxy.py").touch()
        monkeypatch.syspath_prepend(tmp_path)
    show_all(address, public_url=public_url)
    (cell,) = cells
    assert f'<a href="{link}"' in cell
    assert "None" not in cell
    printed = capsys.readouterr().out
    assert (FORWARDING in printed) == (is_remote and link == LOCAL)
    assert ("window.open" in cell) == (FORWARDING not in printed)
    assert opened == []


@pytest.mark.usefixtures("in_hub", "cells")
def test_in_a_notebook_of_a_hub_the_page_answers_for_the_hubs_name(tmp_path):
    with closing(play(Line, database=tmp_path / "plays.db")) as plays:
        hub, strange = {"Host": "hub.example"}, {"Host": "hub example"}
        page = httpx.get(plays.link, headers=hub, trust_env=False)
        board, sessions = {"player": "human"}, f"{plays.link}api/sessions"
        origins = [
            httpx.post(sessions, json=board, headers={**hub, "Origin": origin}, trust_env=False)
            for origin in ("http://hub.example", "http://other.example")
        ]
        refused = httpx.get(plays.link, headers=strange, trust_env=False)
    assert [page.status_code, refused.status_code] == [200, 400]
    assert [answer.status_code for answer in origins] == [201, 403]


@pytest.mark.parametrize("options", [{"host": "0.0.0.0"}, {"public_url": "http://ours.example"}])
@pytest.mark.usefixtures("in_hub")
def test_a_page_that_has_names_answers_for_no_other(tmp_path, options):
    port = free_port()
    arguments = {"database": tmp_path / "plays.db", "port": port, "wait": False, "browser": False}
    with closing(play(Line, **arguments, **options)):
        foreign = {"Host": "hub.example"}
        page = httpx.get(f"http://127.0.0.1:{port}/", headers=foreign, trust_env=False)
    assert page.status_code == 400


@pytest.mark.parametrize(
    "options", [(), ("--host", "0.0.0.0"), ("--public-url", "https://play.example")]
)
def test_a_server_does_not_answer_for_every_name(monkeypatch, tmp_path, capsys, options):
    monkeypatch.setenv("HUMANPLAY_ANY_HOST", "true")
    if options:
        monkeypatch.setenv("HUMANPLAY_CONFINED", "false")
    code, _, error = command(capsys, "serve", "--database", tmp_path / "plays.db", *options)
    assert code == 2
    assert "HUMANPLAY_ANY_HOST: expected false" in error


def test_colab_is_refused_with_the_way_out(monkeypatch):
    monkeypatch.setitem(sys.modules, "google.colab", ModuleType("google.colab"))
    with pytest.raises(PilotError, match="pip install humanplay jupyterlab"):
        play("FrozenLake-v1", wait=False, browser=False)
