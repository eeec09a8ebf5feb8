"""An episode's level: people's networks and clocks pass, inventions do not."""

import random
import secrets
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanplay.board.attestation import (
    LEVELS,
    AttestationResult,
    Conditions,
    attest,
    attest_stored,
    key_map_of,
    level_reaches,
    prepare_end,
    shows_program,
    shows_program_at_once,
)
from humanplay.db.input_events import InputEventRow, add_input_events
from humanplay.db.store import StepRow, Store
from humanplay.tasks.mars.environment import KEYS
from tests.support.page_loads import STORED_LOAD
from tests.support.recorded import add_session, open_episode

STARTED = 1_790_000_000_000
CODES = ("ArrowUp", "ArrowRight", "ArrowDown", "ArrowLeft")
CONDITIONS = Conditions(STARTED, key_map_of(KEYS))


class Page:
    """A page loaded at `loaded_ms` of the server's clock, and what it sends."""

    def __init__(self, loaded_ms=STARTED - 20_000.0, speed=1.0, grain_ms=0.1, number=0):
        self.loaded_ms, self.speed, self.grain_ms = loaded_ms, speed, grain_ms
        self.number = number

    def ms(self, at_ms):
        """What performance.now() says at a time of the server's clock."""
        return round((at_ms - self.loaded_ms) * self.speed // self.grain_ms * self.grain_ms, 1)


class Episode:
    """An episode's rows, made press by press; `at` is the time on the server's clock."""

    def __init__(self, seed=1):
        self.random = random.Random(seed)
        self.moves, self.events, self.at = [], [], STARTED + 800.0
        self._received = 0.0

    def press(
        self, page, gap_ms=None, latency_ms=12.0, behind=0, handling_ms=0.4, action=None, **changes
    ):
        """Press a key `gap_ms` after the press before.

        Event and move arrive `latency_ms` later, never before earlier ones.
        """
        self.at += self.random.lognormvariate(5.6, 0.35) if gap_ms is None else gap_ms
        action = self.random.randrange(4) if action is None else action
        step, sent = len(self.moves), self.at + handling_ms
        self._received = max(self._received, sent + latency_ms)
        event = {
            "page_load": page.number,
            "kind": "keydown", "code": CODES[action], "repeat": 0, "trusted": 1, "client_ms": page.ms(self.at),
            "step": step - behind, "round_trip_ms": 2 * latency_ms if step else None, "server_ms": int(self._received),
            **changes,
        }  # fmt: skip
        move = {
            "step": step, "action": action, "driver": "human", "input": "key", "key_down_ms": page.ms(self.at),
            "client_ms": page.ms(sent), "server_ms": int(self._received),
        }  # fmt: skip
        self.events += [
            event,
            {**event, "kind": "keyup", "client_ms": page.ms(self.at + 70), "repeat": None},
        ]
        self.moves.append(move)
        self.at = (
            max(self.at, self._received + latency_ms - 60) if not behind else self.at
        )  # nobody answers an unseen frame
        return self

    def presses(self, page, count, **how):
        for _ in range(count):
            self.press(page, **how)
        return self

    def level(self, conditions=CONDITIONS):
        return attest(self.moves, self.events, conditions)


def played(count=60, page=None, **how):
    return Episode().presses(page or Page(), count, **how)


def test_a_person_at_a_page_is_attested():
    assert played().level() == AttestationResult("attested")
    assert Episode().level() == AttestationResult("attested"), "without a move nothing differs"


def test_supervised_is_what_was_played_within_four_hours_of_the_operators_code():
    at = {
        -60_000: "supervised",
        -4 * 3_600_000: "supervised",
        -4 * 3_600_000 - 1: "attested",
        1: "attested",
    }
    levels = {
        ms: played().level(Conditions(STARTED, key_map_of(KEYS), (STARTED + ms,))).level
        for ms in at
    }
    assert levels == at


def test_levels_have_an_order_and_a_script_has_none():
    assert [level_reaches(level, "attested") for level in LEVELS] == [
        False, False, True, True
    ]  # fmt: skip
    assert not level_reaches(None, "unattested")


def test_late_messages_are_no_lie():
    episode = played(10)
    episode.presses(Page(), 8, latency_ms=4_000.0)
    assert episode.presses(Page(), 20).level().level == "attested"
    slow = Episode().presses(Page(), 1, latency_ms=9_000.0).presses(Page(), 30)
    assert slow.level().level == "attested", "the first message tells nothing of the clock"


def test_typing_ahead_is_no_lie():
    episode = Episode()
    for _ in range(6):
        for behind in range(4):
            episode.press(Page(), gap_ms=55, behind=behind, latency_ms=150)
        episode.at += 400
    assert episode.level().level == "attested"


BURSTS = Conditions(STARTED, key_map_of(KEYS), types_ahead=True)
"""Of a board whose page keeps every press, however fast they come."""


def burst(presses, gap_ms=65, latency_ms=150.0):
    """An episode that ends in a burst, typed before the page shows any answer."""
    episode = played(6)
    for behind in range(presses):
        episode.press(Page(), gap_ms=gap_ms, behind=behind, latency_ms=latency_ms)
    return episode


def test_a_burst_while_the_screen_stands_still_is_no_lie_where_the_page_keeps_its_presses():
    assert burst(40).level(BURSTS) == AttestationResult("attested")
    assert burst(30).level().reason == "step 15: the press answers the frame of step 6", (
        "a study's page keeps four"
    )
    assert "the frame of step 6" in burst(60).level(BURSTS).reason, (
        "for longer than three seconds nobody types blindly"
    )
    assert "presses in" in burst(30, gap_ms=30).level(BURSTS).reason, (
        "hands are as fast as hands are"
    )
    late = burst(30, latency_ms=1.0)
    late.events[-2]["server_ms"] = late.moves[-1]["server_ms"] = late.moves[6]["server_ms"] + 3_001
    assert "the frame of step 6" in late.level(BURSTS).reason, (
        "by the server's clock, whatever the page says"
    )


def test_an_hour_with_clocks_that_run_apart_is_no_lie():
    for speed in (0.9995, 1.0005):
        assert played(300, Page(speed=speed), gap_ms=12_000).level().level == "attested"


def test_a_clock_of_a_hundred_milliseconds_is_no_lie():
    for seed in range(20):
        page = Page(STARTED - 12_345.67, grain_ms=100)
        assert Episode(seed).presses(page, 60, latency_ms=1.0).level().level == "attested"


def test_a_page_that_is_busy_for_seconds_is_no_lie():
    assert played(20, handling_ms=3_000.0, latency_ms=5.0).level().level == "attested"


def test_a_reload_a_second_tab_and_a_sleep_are_no_lies():
    episode, first = played(12), Page()
    episode.at += 1_500
    second = Page(episode.at - 900, number=1)
    episode.presses(second, 10)
    episode.at += 30_000
    for page in (first, second):  # a clock that stands still while the machine sleeps
        page.loaded_ms += 29_000
    for page in (second, first, second, first):
        episode.at += 700
        episode.presses(page, 4)
    assert episode.level().level == "attested"


def test_a_phone_that_sleeps_between_moves_is_no_lie():
    episode, page = Episode(), Page()
    for _ in range(20):
        episode.presses(page, 2)
        episode.at += 15_000
        page = Page(page.loaded_ms + 14_000)
    assert episode.level().level == "attested"


def test_touches_on_the_arrows_count_as_keys_do():
    episode = Episode()
    for action in (1, 2, 1, 0):
        episode.press(
            Page(), action=action, kind="touchdown", code=("north", "east", "south", "west")[action]
        )
        episode.moves[-1]["input"] = "touch"
    assert episode.level().level == "attested"
    episode.moves[2]["input"] = "key"
    assert "no press of its own" in episode.level().reason


def test_a_key_drives_where_the_participant_has_put_it_now_or_earlier():
    episode = played(3)
    episode.press(Page(), action=1, code="KeyL")
    assert episode.level().reason == "step 3: the press 'KeyL' does not drive where the move went"
    for settings in (
        [{"keys": {"east": ["KeyL", "KeyD"]}}],
        [{"keys": {"east": ["KeyL"]}}, {"keys": {}}, {"modality": "touch"}],
    ):
        assert episode.level(Conditions(STARTED, key_map_of(KEYS, settings))).level == "attested"


def broken(harm):
    """An honest episode with one thing changed at step 30."""
    episode = played()
    move, events = episode.moves[30], [row for row in episode.events if row["kind"] == "keydown"]
    press = events[30]
    if harm == "no event":
        episode.events.remove(press)
    elif harm == "no events":
        episode.events.clear()
    elif harm == "one event for two moves":
        episode.events.remove(press)
        move.update(key_down_ms=events[29]["client_ms"], action=episode.moves[29]["action"])
    elif harm == "in another order":
        one, two = episode.events.index(press), episode.events.index(events[31])
        episode.events[one], episode.events[two] = events[31], press
    elif harm == "a script's":
        move["driver"] = "script"
    else:
        (press if harm in press and harm != "server_ms" else move).update(CHANGES[harm])
        if harm == "server_ms":
            press["server_ms"] = move["server_ms"] + 1
    return episode


CHANGES = {
    "trusted": {"trusted": 0}, "repeat": {"repeat": 1}, "code": {"code": "KeyQ"}, "kind": {"kind": "touchdown"},
    "step": {"step": 31}, "round_trip_ms": {"round_trip_ms": -1}, "input": {"input": None},
    "key_down_ms": {"key_down_ms": None}, "client_ms": {"client_ms": 0.0}, "server_ms": {},
}  # fmt: skip


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        ("no event", "step 30: no press of its own was received before the move"),
        ("no events", "step 0: no press of its own was received before the move"),
        ("one event for two moves", "step 30: no press of its own"),
        ("in another order", "step 31: no press of its own"),
        ("a script's", "step 30: the move came from no key and no touch"),
        ("trusted", "step 30: the browser does not vouch for the press"),
        ("repeat", "step 30: no press of its own"),
        ("code", "step 30: the press 'KeyQ' does not drive where the move went"),
        ("kind", "step 30: no press of its own"),
        ("step", "step 30: the press answers the frame of step 31"),
        ("round_trip_ms", "step 30: a round trip of -1 ms cannot be"),
        ("input", "step 30: the move came from no key and no touch"),
        ("key_down_ms", "step 30: the move says no times"),
        ("server_ms", "step 30: its press was received after the move"),
    ],
)
def test_one_move_that_does_not_fit_its_event_spoils_the_whole_episode_and_the_first_unmakes_it(
    harm, reason
):
    attestation = broken(harm).level()
    assert attestation.level == ("unattested" if reason.startswith("step 0:") else "spoilt")
    assert attestation.reason.startswith(reason)
    assert attestation.step == int(reason.split(":")[0].removeprefix("step "))


@pytest.mark.parametrize("step", [-1, None, 31])
def test_a_frame_that_was_never_shown_is_a_lie_in_a_burst_too(step):
    episode = played()
    [row for row in episode.events if row["kind"] == "keydown"][30]["step"] = step
    assert episode.level(BURSTS).reason == f"step 30: the press answers the frame of step {step}"


def test_a_press_of_long_ago_a_frame_of_long_ago_and_a_move_before_its_press_are_lies():
    assert "sent 15000 ms after" in played(20, handling_ms=15_000.0).level().reason
    assert "sent -500 ms after" in played(20, handling_ms=-500.0).level().reason
    assert (
        "the frame of step 0" in Episode().presses(Page(), 9).press(Page(), behind=9).level().reason
    )


@pytest.mark.parametrize("speed", [0.1, 0.5, 2, 10, 100])
def test_a_clock_that_runs_faster_or_slower_than_the_servers_is_a_lie(speed):
    attestation = played(60, Page(speed=speed)).level()
    assert attestation.level == "spoilt"
    assert "clock" in attestation.reason or "presses in" in attestation.reason


def forged(times, real_ms=3.0, loads=lambda step: 0):
    """Moves every `real_ms` of the server's time, with stamps of one's choice.

    `times(step)` is a stamp, in ms since `loads(step)`.
    """
    episode = Episode()
    for step in range(40):
        episode.press(Page(number=loads(step)), gap_ms=real_ms, latency_ms=0.5)
        stamp = times(step)
        episode.events[-2]["client_ms"] = episode.moves[-1]["key_down_ms"] = episode.moves[-1][
            "client_ms"
        ] = stamp
    return episode.level()


def test_made_up_times_are_lies():
    rng = random.Random(3)
    copied = [row["client_ms"] for row in played(40).events if row["kind"] == "keydown"]
    assert forged(lambda step: 5_000.0).level in ("unattested", "spoilt"), "all at once"
    assert forged(lambda step: 5_000.0 + 300 * step).level in ("unattested", "spoilt"), (
        "a person's pace in a hundredth of the time"
    )
    assert forged(lambda step: copied[step]).level in ("unattested", "spoilt"), "another episode's"
    assert forged(lambda step: rng.uniform(0, 60_000)).level in ("unattested", "spoilt"), (
        "at random"
    )
    assert forged(lambda step: 60_000.0 - 300 * step).level in ("unattested", "spoilt"), "backwards"
    anew = forged(lambda step: 1_000.0, loads=lambda step: step)
    assert anew.level in ("unattested", "spoilt"), "the page loaded anew for every move"
    turns = forged(lambda step: 5_000.0 + 300 * (step // 8), loads=lambda step: step % 8)
    assert turns.level in ("unattested", "spoilt"), "eight tabs in turn, each at a person's pace"


def test_stamps_before_the_frames_that_they_answer_are_lies():
    episode = Episode()
    for _ in range(40):
        episode.press(Page(), gap_ms=300, latency_ms=200.0)
        press, move = episode.events[-2], episode.moves[-1]
        press["client_ms"] = move["key_down_ms"] = move["client_ms"] = round(
            move["client_ms"] - 500.0 * len(episode.moves), 1
        )
    assert episode.level().level == "spoilt"


def test_nobody_presses_ten_times_in_four_hundred_milliseconds_or_fifty_times_in_three_seconds():
    assert (
        played(60, gap_ms=3.0, latency_ms=0.5)
        .level()
        .reason.startswith("step 0: 5 presses in 12 ms")
    )
    assert "10 presses in 360 ms" in played(60, gap_ms=40.0, latency_ms=0.5).level().reason
    assert "50 presses in" in played(60, gap_ms=55.0, latency_ms=0.5).level().reason
    assert played(60, gap_ms=65.0, latency_ms=0.5).level().level == "attested"
    assert played(9, gap_ms=30.0, latency_ms=0.5).level().level == "attested", "a burst of nine"
    assert "5 presses in 40 ms" in played(8, gap_ms=10.0, latency_ms=0.5).level().reason
    resting = Episode()
    for _ in range(6):
        resting.presses(Page(), 9, gap_ms=1.0, latency_ms=0.5).at += 620
    assert "5 presses in 4 ms" in resting.level().reason


@pytest.mark.parametrize("grain_ms", [0.1, 1000 / 60, 100.0])
@given(
    seed=st.integers(0, 999),
    groups=st.lists(st.tuples(st.integers(1, 4), st.sampled_from((0, 12, 30))), max_size=12),
)
def test_chords_and_rolls_raise_no_alarm_whatever_the_clock_is_rounded_to(grain_ms, seed, groups):
    """Up to four keys at once or within 90 ms, then the pause that a hand needs."""
    episode, page = Episode(seed), Page(grain_ms=grain_ms)
    for keys, apart_ms in groups:
        episode.press(page, gap_ms=episode.random.uniform(260, 400))
        episode.presses(page, keys - 1, gap_ms=apart_ms, behind=0, latency_ms=0.5)
    assert episode.level(BURSTS).reason is None


class Hands(Episode):
    """What hands do: gestures between rests, now and then a lost message or a reload."""

    def __init__(self, seed, grain_ms):
        super().__init__(seed)
        self.page = Page(grain_ms=grain_ms)

    def make(self, gesture, count, apart_ms):
        before = len(self.events)
        self.press(self.page, gap_ms=self.random.uniform(260, 400))
        getattr(self, gesture)(count, apart_ms, before)

    def tap(self, count, apart_ms, before):
        for _ in range(count - 1):
            self.press(self.page, gap_ms=self.random.uniform(65, 200), latency_ms=apart_ms)

    def roll(self, count, apart_ms, before):
        self.presses(self.page, min(count, 4) - 1, gap_ms=apart_ms, latency_ms=0.5)

    def hold(self, count, apart_ms, before):
        down = self.events[before]
        for number in range(count):
            at_ms = self.at + 300 + 30 * number
            repeat = {"client_ms": self.page.ms(at_ms), "server_ms": int(at_ms + 12), "repeat": 1}
            self.events.insert(-1, {**down, **repeat})
        self.at += 300 + 30 * count

    def lose(self, count, apart_ms, before):
        del self.events[before:]

    def reload(self, count, apart_ms, before):
        self.at += 2_500
        self.page = Page(self.at, grain_ms=self.page.grain_ms, number=self.page.number + 1)


@pytest.mark.parametrize("grain_ms", [0.1, 1000 / 60, 100.0])
@given(
    seed=st.integers(0, 999),
    gestures=st.lists(
        st.tuples(
            st.sampled_from(("tap", "roll", "hold", "lose", "reload")),
            st.integers(1, 40),
            st.sampled_from((0, 12, 30)),
        ),
        max_size=8,
    ),
)
def test_hands_are_never_called_a_program_whatever_is_held_lost_or_loaded_again(
    grain_ms, seed, gestures
):
    hands = Hands(seed, grain_ms)
    for gesture in gestures:
        hands.make(*gesture)
    reason = hands.level().reason
    assert not shows_program(reason), reason
    if not any(gesture == "lose" for gesture, *_ in gestures):
        assert reason is None


def test_a_held_key_is_told_from_a_program_by_its_repeat_flags_alone():
    held = Hands(1, 0.1)
    held.make("hold", 20, 0)
    assert held.level().reason is None
    pressed = played(1).presses(Page(), 1, gap_ms=300, latency_ms=0.5)
    pressed.presses(Page(), 20, gap_ms=30, latency_ms=0.5)
    assert shows_program_at_once(pressed.level().reason)


@pytest.mark.parametrize(("slow", "is_at_once"), [(0, True), (5, True), (6, False), (20, False)])
def test_a_program_shows_at_once_or_after_a_persons_moves(slow, is_at_once):
    """The first fast press follows the last slow one: a sixth slow move is a person's."""
    episode = played(slow, latency_ms=0.5).presses(Page(), 20, gap_ms=10, latency_ms=0.5)
    reason = episode.level().reason
    assert shows_program(reason)
    assert shows_program_at_once(reason) == is_at_once


def test_the_first_press_that_comes_too_soon_decides_whichever_floor_it_is_under():
    episode = played(20, gap_ms=30, latency_ms=0.5).presses(Page(), 5, gap_ms=1, latency_ms=0.5)
    assert episode.level().reason.startswith("step 0: 10 presses in")


def test_five_presses_by_a_rounded_clock_take_twice_as_long():
    episodes = {
        grain: played(5, Page(grain_ms=grain), gap_ms=26.0, latency_ms=0.5)
        for grain in (0.1, 100.0)
    }
    assert episodes[0.1].level().level == "attested"
    assert episodes[100.0].level().reason == "step 0: 5 presses in 100 ms"


def store_rows(store, episode_id, moves, events):
    """Put moves and events of an `Episode` into a store."""
    for event in events:
        add_input_events(
            store,
            episode_id,
            [InputEventRow(*(event[name] for name in InputEventRow._fields))],
            event["server_ms"],
            secrets.token_hex(8),
            STORED_LOAD,
        )
    for move in moves:
        store.add_step(StepRow(episode_id, reward=0.0, discovered=1, key_up_ms=None, **move))


def test_what_is_prepared_before_the_end_says_the_same_and_is_made_again_where_something_has_changed(
    tmp_path,
):
    """The last move is not stored yet when the end is prepared.

    Nothing of it may come later unseen.
    """
    episode = played(20)
    elsewhere = Conditions(STARTED, {key: {0} for key in CONDITIONS.key_map})
    with closing(Store(tmp_path / "play.db")) as store:
        episode_id = open_episode(store, add_session(store), seed=1, started_ms=STARTED)[0].id
        store_rows(store, episode_id, episode.moves[:-1], episode.events[:-2])
        early = prepare_end(store, episode_id, CONDITIONS, episode.moves[-1])
        store_rows(store, episode_id, [], episode.events[-2:])
        ending = prepare_end(store, episode_id, CONDITIONS, episode.moves[-1])
        store_rows(store, episode_id, episode.moves[-1:], [])
        assert prepare_end(store, episode_id, None, None).attestation is None
        assert (early.attestation.level, ending.attestation.level) == ("spoilt", "attested")
        for prepared in (ending, early, None):
            assert attest_stored(store, episode_id, CONDITIONS, prepared).level == "attested"
            assert attest_stored(store, episode_id, elsewhere, prepared).level == "unattested"
