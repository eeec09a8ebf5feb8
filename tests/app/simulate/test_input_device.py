"""The input of synthetic players looks like a person's, a cheater's like a machine's, however much time is compressed."""

import asyncio
import time

import numpy as np
import pytest

from app.simulate.input_device import InputDevice, PageClock
from app.simulate.persona import PLAYER_KINDS, draw_persona
from app.simulate.population import SIMULATED_POPULATIONS
from app.study.plausibility import intervals, pause_share, plausibility_labels


def press(kind, presses, speed=1e6, number=0, idle_ms=0.0):
    """The input events of some presses, answered at once."""

    async def work():
        device = InputDevice(
            draw_persona(number, kind, SIMULATED_POPULATIONS["mixed"], 1),
            PageClock(speed),
            np.random.default_rng(number),
        )
        for step in range(presses):
            action = ("east", "south")[step // 3 % 2]
            await device.wait_to_decide(action)
            timing = device.press(action, step)
            assert timing["key_down_ms"] <= timing["client_ms"]
            await device.release(action, step + 1, 2.0)
        if idle_ms:
            await device.idle(idle_ms, presses)
            await device.wait_to_decide("east")
            device.press("east", presses)
        return device.events

    return asyncio.run(work())


def of_kind(events, *kinds):
    return [event for event in events if event["kind"] in kinds]


@pytest.mark.parametrize("number", range(6))
def test_a_person_is_labelled_nothing(number):
    events = press("noisy-frontier", 200, number=number)
    assert plausibility_labels([], events) == ()
    gaps = intervals(of_kind(events, "keydown", "touchdown"))
    assert 200 < np.median(gaps) < 900
    times = [event["client_ms"] for event in events]
    assert times == sorted(times)


def test_both_keyboards_and_touch_screens_occur():
    kinds = {press("noisy-frontier", 1, number=number)[0]["kind"] for number in range(60)}
    assert kinds == {"keydown", "touchdown"}


def test_a_cheater_is_labelled_a_machine():
    assert {"robotic timing", "no key-up", "under 80 ms"} <= set(
        plausibility_labels([], press("cheater", 40))
    )


def test_compressed_time_is_short_and_looks_long():
    began = time.perf_counter()
    events = press("noisy-frontier", 30, speed=1000.0)
    assert events[-1]["client_ms"] > 9_000
    assert time.perf_counter() - began < 4.0


def test_at_the_speed_of_people_the_clock_is_the_wall():
    before = time.perf_counter()
    clock = PageClock(1.0)
    after = time.perf_counter()
    asyncio.run(clock.wait(120.0))
    least = (time.perf_counter() - after) * 1000
    now = clock.now_ms()
    most = (time.perf_counter() - before) * 1000
    assert least >= 119.0
    assert least - 1.0 <= now <= most + 1.0


def test_an_idler_pauses_its_page():
    events = press("idler", 20, idle_ms=150_000.0)
    assert [event["kind"] for event in of_kind(events, "hidden", "pause", "visible", "resume")] == [
        "hidden",
        "pause",
        "visible",
        "resume",
    ]
    assert pause_share([], events) > 0.8
    assert plausibility_labels([], events) == ()
    assert PLAYER_KINDS["idler"].pauses > 0
