"""Labels: each on what it is for, none on plain play, and pauses as a share of time."""

import pytest

from app.series.plausibility import LABELS, pause_share, plausibility_labels


def press(at, up=True, kind="keydown", **rest):
    down = {
        "kind": kind,
        "code": "ArrowUp",
        "repeat": 0,
        "trusted": 1,
        "client_ms": float(at),
        **rest,
    }
    return (
        [down, {**down, "kind": kind.replace("down", "up"), "client_ms": at + 60.0}]
        if up
        else [down]
    )


def presses(times, **rest):
    return [row for at in times for row in press(at, **rest)]


def event(kind, at):
    return {"kind": kind, "code": None, "repeat": None, "trusted": None, "client_ms": float(at)}


HUMAN = [
    0,
    310,
    540,
    1200,
    1390,
    1720,
    2400,
    2630,
    3100,
    3290,
    3900,
    4350,
    4600,
    5400,
    5590,
    5900,
    6700,
    6950,
    7200,
    8000,
    8300,
    8900,
]


def test_plain_play_has_no_label():
    assert plausibility_labels([], presses(HUMAN)) == ()
    assert plausibility_labels([], presses(HUMAN, kind="touchdown")) == ()
    assert plausibility_labels([], []) == ()


def test_a_machines_beat_is_robotic_even_with_a_rest_in_it():
    times = [250 * k + (7 if k % 2 else 0) for k in range(24)]
    assert plausibility_labels([], presses(times)) == ("robotic timing",)
    assert plausibility_labels([], presses(times[:12] + [at + 90_000 for at in times[12:]])) == (
        "robotic timing",
    )
    assert plausibility_labels([], presses(times[:20])) == ()  # 19 intervals are too few to tell


def test_keys_that_never_come_up():
    assert plausibility_labels([], presses(HUMAN, up=False)) == ("no key-up",)
    half = [row for number, at in enumerate(HUMAN) for row in press(at, up=number % 2 == 0)]
    assert plausibility_labels([], half) == ()
    assert plausibility_labels([], presses(HUMAN[:4], up=False)) == ()


def test_presses_closer_than_a_person_can_react():
    fast = [*HUMAN[:10], 3300, 3340, *HUMAN[10:]]
    assert plausibility_labels([], presses(fast)) == ()  # two of 23 may happen with two fingers
    faster = sorted(HUMAN + [at + 50 for at in HUMAN[:6]])
    assert plausibility_labels([], presses(faster)) == ("under 80 ms",)


def test_auto_repeat_is_no_press():
    held = presses(HUMAN) + [
        row for at in range(9000, 9900, 33) for row in press(at, up=False, repeat=1)
    ]
    assert plausibility_labels([], held) == ()


def test_a_press_that_the_browser_does_not_vouch_for():
    assert plausibility_labels([], [*presses(HUMAN), *press(9500, trusted=0)]) == ("untrusted",)
    assert plausibility_labels([], [*presses(HUMAN), *press(9500, trusted=None)]) == ()


def test_a_press_while_the_page_was_hidden():
    rows = [*presses(HUMAN), event("hidden", 9100), *press(9500), event("visible", 9900)]
    assert plausibility_labels([], rows) == ("unfocused",)
    assert (
        plausibility_labels(
            [], [*presses(HUMAN), event("hidden", 9100), event("visible", 9300), *press(9500)]
        )
        == ()
    )


def test_moves_by_key_without_any_input_event():
    moves = [{"input": "key", "server_ms": 1000 * k} for k in range(6)]
    assert plausibility_labels(moves, []) == ("no telemetry",)
    assert plausibility_labels([{**move, "input": None} for move in moves], []) == ()
    assert plausibility_labels(moves, presses(HUMAN)) == ()


def test_a_reload_begins_the_clock_anew_without_a_label():
    assert plausibility_labels([], presses(HUMAN + [at / 2 + 17 for at in HUMAN if at % 3])) == ()


def test_several_labels_stand_in_the_order_of_the_list():
    rows = presses([250 * k for k in range(30)], up=False, trusted=0)
    found = plausibility_labels([], rows)
    assert found == ("robotic timing", "no key-up", "untrusted")
    assert [name for name in LABELS if name in found] == list(found)


def test_the_share_of_time_paused_or_hidden():
    rows = [
        *press(0),
        event("pause", 1000),
        event("hidden", 2000),
        event("resume", 3000),
        event("visible", 4000),
        *press(5940),
    ]
    assert pause_share([], rows) == pytest.approx(3000 / 6000)
    assert pause_share([], presses(HUMAN)) == 0
    assert pause_share([], press(5, up=False)) == 0


def test_without_input_events_long_gaps_between_moves_count_as_pauses():
    moves = [{"server_ms": at, "input": None} for at in (0, 1000, 91_000, 100_000)]
    assert pause_share(moves, []) == pytest.approx(0.9)
    assert pause_share([], []) == 0
