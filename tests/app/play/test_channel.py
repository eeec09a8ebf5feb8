"""The newest frame, to any number of subscribers."""

import asyncio
import gc

import pytest

from app.board.session import Channel


def test_a_late_subscriber_gets_the_newest_frame_at_once():
    async def scenario():
        channel = Channel()
        channel.publish("1")
        channel.publish("2")
        return await asyncio.wait_for(anext(channel.subscribe()), 1)

    assert asyncio.run(scenario()) == "2"


def test_a_slow_subscriber_skips_and_a_notification_wakes_without_a_new_frame():
    async def scenario():
        channel = Channel()
        with channel.subscribe() as slow:
            for frame in "abc":
                channel.publish(frame)
            assert await anext(slow) == "c"
            channel.notify()
            assert await anext(slow) == "c"
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(slow), 0.01)
            slow.close()
            assert [frame async for frame in slow] == []
        assert channel.subscribers == 0

    asyncio.run(scenario())


def test_a_dropped_subscriber_is_forgotten_and_a_listener_leaves():
    async def scenario():
        channel, frames_seen = Channel(), []
        leave = channel.add_listener(lambda: frames_seen.append(channel.frame))
        subscriber = channel.subscribe()
        assert channel.subscribers == 1
        del subscriber
        gc.collect()
        assert channel.subscribers == 0
        channel.publish("a")
        leave()
        leave()
        channel.publish("b")
        assert frames_seen == ["a"]

    asyncio.run(scenario())
