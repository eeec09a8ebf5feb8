"""What `play` does with environments that have bad habits."""

import re

import httpx
import pytest

from humanplay import play
from humanplay.cli.pilot.errors import PilotError
from tests.app.tasks.test_bad_habits import ENDS, PLAYS, REFUSED
from tests.support import bad_habits


def cases(table, quick):
    """The habits of a table; all but one, which is quick, are for the long tests."""
    return [name if name == quick else pytest.param(name, marks=pytest.mark.long) for name in table]


@pytest.fixture
def opened(tmp_path):
    """`opened(name)` plays an environment, and returns a browser at its page."""
    pages = []

    def call(name):
        kind = getattr(bad_habits, name)
        pages.append(play(kind, database=tmp_path / "plays.db", wait=False, browser=False))
        origin = pages[-1].link.rstrip("/")
        browser = httpx.Client(base_url=origin, headers={"Origin": origin}, trust_env=False)
        pages.append(browser)
        browser.put("/api/me/name", json={"name": "Ada"}).raise_for_status()
        return browser

    yield call
    for page in reversed(pages):
        page.close()


def moved(browser, action):
    """Begin an episode, make a move, and return the frame that follows."""
    begun = browser.post("/api/sessions", json={"player": "human"}).json()
    frame, path = begun["frame"], f"/api/sessions/{begun['session']}"
    move = {"episode": frame["episode"], "step": frame["step"], "action": action}
    browser.post(f"{path}/act", json=move)
    return browser.get(path).json()


@pytest.mark.parametrize("name", cases(PLAYS, "TwoWheels"))
def test_it_plays(opened, name):
    frame = moved(opened(name), PLAYS[name][-1])
    assert (frame["step"], frame["outcome"]) == (1, None)


@pytest.mark.parametrize("name", cases(REFUSED, "FloatPicture"))
def test_it_is_refused_with_the_way_out(opened, name):
    with pytest.raises(PilotError, match=re.escape(REFUSED[name])):
        opened(name)


@pytest.mark.parametrize(
    ("name", "line"), [("NoReset", 'raise KeyError("no level file")'), ("FloatPicture", "")]
)
def test_before_the_page_opens_the_author_reads_which_line_of_theirs_raised(
    opened, name, line, capfd
):
    with pytest.raises(PilotError):
        opened(name)
    text = capfd.readouterr().out
    assert line in text
    assert ("Traceback" in text) == bool(line)


@pytest.mark.parametrize("name", cases(ENDS, "Raises"))
def test_it_ends_its_own_episode_and_the_author_reads_why(opened, name, capfd):
    browser = opened(name)
    assert moved(browser, "1")["outcome"] == "environment_failed"
    text = capfd.readouterr().out
    assert ENDS[name] in text
    assert "step 1, action 1 (1)" in text
