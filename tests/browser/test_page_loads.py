"""Whoever reloads, opens a second tab or loses the connection counts as others do."""

import random
import sqlite3
import time
from contextlib import closing

import pytest

from humanplay.db.store import Store
from humanplay.report.statistics.exclusion_sets import members, people_of
from humanplay.study.closing import note_closed
from humanplay.study.data import load
from humanplay.study.folder import Folder
from tests.browser.test_study_page import Participant
from tests.support.browser import AS_A_PERSON, NO_3D
from tests.support.study import freeze

PACE_MS = (250, 700)
"""Between two presses: a person looks at the board, and not by the clock."""


class Visitor(Participant):
    """A participant at a person's pace.

    `away_s` is how long at most nobody could have been at the board.
    """

    def __init__(self, page, url):
        super().__init__(page, url)
        self.away_s, self.dice = 0.0, random.Random(0)

    def press(self, action):
        self.page.wait_for_timeout(self.dice.uniform(*PACE_MS))
        super().press(action)

    def begin(self):
        """Begin the next episode."""
        self.page.keyboard.press("Enter")
        self.driving()
        self.policy.reset(0)

    def moves(self, count):
        for _ in range(count):
            self.press(self.next_action())

    def is_away(self, work):
        """Do what takes the page from its reader."""
        began = time.monotonic()
        work()
        self.driving()
        self.away_s += time.monotonic() - began


def to_ranked(open_browser, server):
    """Go through everything before the ranked episodes, which begin with Enter."""
    me = Visitor(open_browser([*NO_3D, *AS_A_PERSON]).new_context().new_page(), server.url)
    me.goto().stands("consent")
    me.choose("agree")
    me.stands("instructions")
    me.choose("to-tutorial")
    me.driving()
    me.page.get_by_test_id("skip").click()
    me.stands("ready")
    return me


def look_elsewhere(me):
    """Go to another page in the same tab, and back."""
    me.page.goto("about:blank")
    me.page.wait_for_timeout(1_000)
    me.page.go_back()


def open_a_second_tab(me):
    """Open the study in a second tab, with the first one hidden, and close it."""
    tab = Participant(me.page.context.new_page(), me.url)
    tab.goto().driving()
    assert tab.frame == me.frame
    tab.page.close(run_before_unload=True)
    assert tab.errors == []


def played_ms(tmp_path, episode):
    """The time from an episode's first move to its last, by the server's clock."""
    with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
        sql = "SELECT max(server_ms) - min(server_ms) FROM steps WHERE episode_id = ?"
        return db.execute(sql, [episode]).fetchone()[0]


@pytest.mark.long
def test_reloads_a_second_tab_a_lost_connection_and_a_return_leave_the_columns_as_they_are(
    spawn, open_browser, tmp_path
):
    freeze(
        tmp_path / "playground.db-studies", "tiny", size=(13, 14), warm_up=0, ranked=2, break_every=9, questions=(),
        pause_after_s=900,
    )  # fmt: skip
    server = spawn()
    quiet, busy = to_ranked(open_browser, server), to_ranked(open_browser, server)
    for _ in range(2):
        quiet.begin()
        quiet.explore()

    busy.begin()
    busy.moves(5)
    busy.is_away(busy.page.reload)
    busy.moves(2)
    busy.is_away(lambda: open_a_second_tab(busy))
    busy.explore()
    busy.begin()
    busy.moves(3)
    server.kill()
    busy.wait("window.study.state.game.link === 'lost'")
    server = spawn(port=server.port)
    busy.driving()
    busy.moves(2)
    busy.is_away(lambda: look_elsewhere(busy))
    busy.explore()
    for me in (quiet, busy):
        me.page.keyboard.press("Enter")
        me.stands("debrief")
        me.wait("window.study.waiting === 0")
        assert me.errors == []
    boards = [me.state("participant.session") for me in (quiet, busy)]
    server.kill()

    studies = Folder(tmp_path / "playground.db-studies")
    studies.close("tiny")
    with closing(Store(tmp_path / "playground.db")) as store:
        note_closed(store, studies.study("tiny"))
    data = load(tmp_path / "playground.db", "tiny")
    people = people_of(data)
    ranked = [trial for trial in data.trials if trial.phase == "ranked"]
    for trial in ranked:
        assert (trial.driver, trial.attestation, trial.labels) == ("human", "attested", ())
    calm, torn = (
        sorted(
            (trial for trial in ranked if trial.session_id == board),
            key=lambda trial: trial.terrain_index,
        )
        for board in boards
    )
    assert [trial.trajectory_hash for trial in calm] == [trial.trajectory_hash for trial in torn]
    assert [trial.pause_share for trial in calm] == [0, 0]
    for trial, undisturbed in zip(torn, calm, strict=True):
        assert 0 < trial.pause_share < 0.5
        assert undisturbed.active_ms / 2 < trial.active_ms < undisturbed.active_ms * 2
    away_ms = sum(trial.pause_share * played_ms(tmp_path, trial.id) for trial in torn)
    assert away_ms <= 1000 * busy.away_s
    for rules in ({}, *data.protocol.exclusion.values()):
        assert len(members(people, rules)) == 2, rules
