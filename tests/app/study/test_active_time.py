"""Time at an episode without pauses, by each page load's own clock."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanplay.study.active_time import active_ms, pause_share

QUIET_MS = 60_000
T = 1_790_000_000_000


class Browser:
    """What a server stores of one person's tabs, in seconds since the episode's start."""

    def __init__(self):
        self.inputs, self.moves = [], []
        self._tabs, self._loaded_s = [], []

    def load(self, tab, at_s, kind="visible"):
        """Load the page in a tab, visible or not, and return the load's number."""
        if tab not in self._tabs:
            self._tabs.append(tab)
        self._loaded_s.append(at_s - 3.7)
        number = len(self._loaded_s) - 1
        self.note(number, tab, kind, at_s)
        return number

    def note(self, load, tab, kind, at_s, delay_s=0.0):
        self.inputs.append(
            {
                "page_load": load,
                "tab": self._tabs.index(tab),
                "kind": kind,
                "client_ms": 1000 * (at_s - self._loaded_s[load]),
                "server_ms": T + 1000 * (at_s + delay_s),
            }
        )

    def press(self, load, tab, at_s):
        self.note(load, tab, "keydown", at_s)
        self.moves.append({"server_ms": T + 1000 * at_s})

    def measured(self, quiet_ms=QUIET_MS):
        """(seconds at it, share of the time between the moves that was not)."""
        active_s = active_ms(self.moves, self.inputs, T, quiet_ms) / 1000
        return pytest.approx(active_s), pytest.approx(
            pause_share(self.moves, self.inputs, quiet_ms)
        )


def played(times_s=range(1, 41)):
    """A person who presses a key each second in one tab."""
    browser = Browser()
    load = browser.load("a", 0.5)
    for at_s in times_s:
        browser.press(load, "a", at_s)
    return browser, load


def test_a_person_who_never_leaves_is_active_all_the_time():
    browser, _ = played()
    assert browser.measured() == (40, 0)


def test_a_page_that_is_left_and_comes_back():
    browser, load = played(range(1, 6))
    browser.note(load, "a", "hidden", 6)
    browser.note(load, "a", "visible", 10)
    browser.press(load, "a", 11)
    assert browser.measured() == (7, 0.4)


def test_a_reload_ends_what_the_load_before_it_said():
    browser, load = played(range(1, 6))
    browser.note(load, "a", "hidden", 6)
    again = browser.load("a", 7)
    for at_s in range(8, 42):
        browser.press(again, "a", at_s)
    assert browser.measured() == (40, 1 / 40)


def test_a_load_that_was_lost_while_visible_does_not_hide_that_the_next_one_is_hidden():
    browser, _ = played(range(1, 6))
    again = browser.load("a", 7)
    browser.note(again, "a", "hidden", 8)
    browser.note(again, "a", "visible", 38)
    browser.press(again, "a", 40)
    assert browser.measured() == (10, 30 / 39)


def test_a_second_tab_that_is_opened_and_closed_costs_no_time():
    browser, first = played(range(1, 6))
    browser.note(first, "a", "hidden", 6)
    second = browser.load("b", 6)
    browser.note(second, "b", "hidden", 10)
    browser.note(first, "a", "visible", 10)
    for at_s in range(11, 41):
        browser.press(first, "a", at_s)
    assert browser.measured() == (40, 0)


def test_two_windows_side_by_side_of_which_one_pauses_and_closes():
    browser, first = played(range(1, 6))
    second = browser.load("b", 6)
    browser.note(second, "b", "pause", 8)
    for at_s in range(9, 20):
        browser.press(first, "a", at_s)
    browser.note(second, "b", "hidden", 20)
    browser.press(first, "a", 40)
    assert browser.measured() == (40, 0)


def test_a_pause_ends_with_resume_or_with_a_press_in_its_load():
    for ends_with in ("resume", "keydown", "touchdown"):
        browser, load = played(range(1, 6))
        browser.note(load, "a", "pause", 6)
        browser.note(load, "a", "hidden", 7)
        browser.note(load, "a", "visible", 8)
        browser.note(load, "a", ends_with, 16)
        browser.press(load, "a", 21)
        assert browser.measured() == (11, 0.5), ends_with


def test_a_press_in_a_page_that_says_hidden_ends_the_pause():
    browser, load = played(range(1, 6))
    browser.note(load, "a", "hidden", 6)
    for at_s in range(7, 12):
        browser.press(load, "a", at_s)
    assert browser.measured() == (10, 0.1)


def test_the_night_between_the_start_and_the_first_move_is_no_time_at_it():
    browser = Browser()
    load = browser.load("a", 1)
    browser.note(load, "a", "hidden", 5)
    browser.note(load, "a", "visible", 30_000)
    for at_s in range(30_001, 30_011):
        browser.press(load, "a", at_s)
    assert browser.measured() == (15, 0)


def test_of_a_silence_as_of_a_machine_that_sleeps_a_minute_counts():
    browser, load = played(range(1, 6))
    browser._loaded_s[load] += 30_000  # the page's clock stands still meanwhile
    for at_s in range(30_006, 30_011):
        browser.press(load, "a", at_s)
    assert browser.measured() == (5 + 60 + 4, pytest.approx(1 - 68 / 30_009))
    moves = [{"server_ms": T + 1000 * at_s} for at_s in (0, 1, 91, 100)]
    assert pause_share(moves, [], QUIET_MS) == pytest.approx(0.3), "nor without input events"


def test_events_that_waited_for_a_connection_stand_at_their_own_time():
    browser, load = played(range(1, 6))
    browser.note(load, "a", "hidden", 6, delay_s=20)
    browser.note(load, "a", "visible", 16, delay_s=10)
    browser.press(load, "a", 27)
    assert browser.measured() == (17, 10 / 26)


def test_without_a_move_there_is_no_time():
    browser, load = played(())
    browser.note(load, "a", "hidden", 6)
    assert browser.measured() == (0, 0)
    browser.press(load, "a", 7)
    assert browser.measured() == (6, 0)


KINDS = ("hidden", "visible", "pause", "resume", "keydown", "blur")
TIMES = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 2), st.sampled_from(KINDS), TIMES), max_size=30
    ),
    st.lists(st.integers(0, 10**7), max_size=5),
)
def test_whatever_a_forger_claims_the_share_is_one(events, moves_ms):
    inputs = [
        {
            "page_load": load,
            "tab": tab,
            "kind": kind,
            "client_ms": client_ms,
            "server_ms": T + number,
        }
        for number, (load, tab, kind, client_ms) in enumerate(events)
    ]
    moves = [{"server_ms": T + ms} for ms in sorted(moves_ms)]
    assert -1e-9 <= pause_share(moves, inputs, QUIET_MS) <= 1 + 1e-9
    assert -1e-3 <= active_ms(moves, inputs, T, QUIET_MS) <= max(moves_ms, default=0)
