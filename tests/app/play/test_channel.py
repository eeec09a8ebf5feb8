"""The newest frame, to any number of followers."""

import asyncio
import gc

import pytest

from app.play.channel import Channel


def test_a_late_follower_gets_the_newest_frame_at_once():
    async def story():
        channel = Channel()
        channel.publish("1")
        channel.publish("2")
        return await asyncio.wait_for(anext(channel.subscribe()), 1)

    assert asyncio.run(story()) == "2"


def test_a_slow_follower_skips_and_a_notification_wakes_without_a_new_frame():
    async def story():
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

    asyncio.run(story())


def test_a_dropped_follower_is_forgotten_and_a_listener_leaves():
    async def story():
        channel, heard = Channel(), []
        leave = channel.add_listener(lambda: heard.append(channel.frame))
        follower = channel.subscribe()
        assert channel.subscribers == 1
        del follower
        gc.collect()
        assert channel.subscribers == 0
        channel.publish("a")
        leave()
        leave()
        channel.publish("b")
        assert heard == ["a"]

    asyncio.run(story())
