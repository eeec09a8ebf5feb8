"""Sessions by id: unloading, resuming, restarts, foreign ids, a failing store."""

import asyncio
import itertools
import threading

import pytest

from humanplay.board.lobby import Lobby, UnknownSessionError
from humanplay.board.messages import ChangePace, Events, InputEvent
from humanplay.board.session import Move
from humanplay.board.sources import Sources
from humanplay.db.store import Store
from humanplay.tasks.mars.messages import NewEpisode, NewSession
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.tasks.mars.task import Mars
from tests.support.page_loads import LOAD

DAY_MS = 86_400_000


@pytest.fixture(scope="module")
def policies():
    return PolicyCatalogue()


@pytest.fixture
def run_in_lobby(tmp_path, policies):
    """`run_in_lobby(scenario)` runs `scenario(lobby)`, any number of times.

    The database stays the same.
    """

    def run(scenario, idle_s=600.0, **sources):
        async def whole():
            store = Store(tmp_path / "playground.db")
            lobby = Lobby(store, Mars(policies), Sources(**sources), idle_s)
            sweeper = asyncio.create_task(lobby.sweep())
            try:
                return await scenario(lobby)
            finally:
                sweeper.cancel()
                lobby.close()
                store.close()

        return asyncio.run(whole())

    return run


def move(session, action=2, **rest):
    return Move(session.current.id, session.shown.steps, action, "human", **rest)


async def until(claim):
    async with asyncio.timeout(20):
        while not claim():
            await asyncio.sleep(0.005)


def test_a_board_that_is_slow_to_resume_delays_no_other(run_in_lobby, monkeypatch):
    async def begin(lobby):
        return [(await lobby.create(NewSession(seed=seed), "me")).id for seed in (5, 6)]

    async def resume(lobby):
        replay, waits = lobby.task.replay, threading.Event()
        slow = lobby.store.resume_session(ids[0]).episode.id

        def replayed(_, was, *rest):
            assert was.id != slow or waits.wait(20)
            return replay(was, *rest)

        monkeypatch.setattr(Mars, "replay", replayed)
        waiting = [asyncio.create_task(lobby.get(ids[0])) for _ in range(2)]
        await asyncio.sleep(0.05)
        assert (await asyncio.wait_for(lobby.get(ids[1]), 5)).id == ids[1]
        assert not any(task.done() for task in waiting)
        waits.set()
        first, second = await asyncio.gather(*waiting)
        assert first is second

    ids = run_in_lobby(begin)
    run_in_lobby(resume)


def test_no_move_after_a_restart_is_earlier_than_what_was_stored_before(run_in_lobby):
    async def begin(lobby):
        session = await lobby.create(NewSession(seed=5), "me", "cookie")
        await session.act(move(session))
        press = InputEvent(kind="keydown", code="KeyS", client_ms=1.0, trusted=True)
        event_ms[0] += 5
        await session.keep_events(
            Events(
                kind="events", episode=session.current.id, batch="b" * 16, **LOAD, events=[press]
            )
        )
        return session.id

    async def go_on(lobby):
        session = await lobby.get(ident)
        await session.act(move(session))
        return [step["server_ms"] for step in lobby.store.steps(session.current.id)]

    event_ms = [DAY_MS]
    ident = run_in_lobby(begin, clock_ms=lambda: event_ms[0])
    assert run_in_lobby(go_on, clock_ms=lambda: DAY_MS - 600) == [DAY_MS, DAY_MS + 5]


def test_a_session_without_subscribers_is_unloaded_and_resumed_where_it_stood(run_in_lobby):
    async def scenario(lobby):
        session = await lobby.create(NewSession(rival="frontier-cost", seed=5), "me")
        rival = lobby.rival_of(session)
        with rival.channel.subscribe():
            await session.act(move(session))
            await until(lambda: rival.shown.steps == 1)
            frames = session.frame, rival.frame
            await asyncio.sleep(0.3)
            assert len(lobby) == 2
        await until(lambda: len(lobby) == 0)
        resumed_rival, resumed = await asyncio.gather(lobby.get(rival.id), lobby.get(session.id))
        assert (resumed.frame, resumed_rival.frame) == frames
        assert lobby.rival_of(resumed) is resumed_rival
        assert resumed is not session
        with resumed_rival.channel.subscribe():
            await resumed.act(move(resumed))
            await until(lambda: resumed_rival.shown.steps == 2)

    run_in_lobby(scenario, idle_s=0.1)


def test_a_restarted_server_knows_players_rivals_and_paces(run_in_lobby):
    async def before(lobby):
        session = await lobby.create(NewSession(rival="frontier-utility", size=[21, 19]), "me")
        rival = lobby.rival_of(session)
        await lobby.change_pace(rival, ChangePace(moves_per_second=60))
        await until(lambda: rival.shown.steps >= 3)
        await lobby.change_pace(rival, ChangePace(pause=True))
        return session.id, rival.id, session.current.terrain, rival.shown.steps

    async def after(lobby):
        rival = await lobby.get(rival_id)
        session = await lobby.get(session_id)
        assert lobby.rival_of(session) is rival
        assert (rival.pace.mode, rival.pace.moves_per_second, rival.shown.steps >= steps) == (
            "paused",
            60,
            True,
        )
        assert session.current.terrain == rival.current.terrain == terrain
        await lobby.restart(session, NewEpisode())
        assert session.current.terrain == rival.current.terrain != terrain

    session_id, rival_id, terrain, steps = run_in_lobby(before)
    run_in_lobby(after)


def test_an_ended_episode_is_shown_for_a_day_and_then_forgotten(run_in_lobby):
    async def before(lobby):
        session = await lobby.create(NewSession(), "me")
        await session.act(move(session, 0))
        other = await lobby.create(NewSession(), "me")
        return session.id, session.frame, other.id, other.frame

    async def within(lobby):
        assert (await lobby.get(session_id)).frame == frame

    async def later(lobby):
        with pytest.raises(UnknownSessionError):
            await lobby.get(session_id)
        assert (await lobby.get(open_id)).frame == open_frame

    session_id, frame, open_id, open_frame = run_in_lobby(before, clock_ms=lambda: 1000)
    run_in_lobby(within, clock_ms=lambda: DAY_MS - 1000)
    run_in_lobby(later, clock_ms=lambda: 3 * DAY_MS)


def test_restarts_at_the_same_time_leave_one_running_episode_each(run_in_lobby):
    async def scenario(lobby):
        session = await lobby.create(NewSession(player="random", rival="frontier-cost"), "me")
        await lobby.change_pace(session, ChangePace(moves_per_second=60))
        for _ in range(5):
            await asyncio.gather(
                *(lobby.restart(session, NewEpisode(size=[20, 23])) for _ in range(4))
            )
            await asyncio.sleep(0.02)
        rival = lobby.rival_of(session)
        assert session.current.number == rival.current.number == 21
        assert session.current.terrain == rival.current.terrain
        assert len({row["episode"] for row in lobby.store.episodes(100)}) == 40
        assert not session.fault
        assert not rival.fault

    run_in_lobby(scenario)


def test_ids_seeds_and_the_clock_come_from_outside(run_in_lobby):
    async def scenario(lobby):
        session = await lobby.create(NewSession(), "me")
        return session.id, session.current.id, session.current.seed, session.current.started_ms

    count = itertools.count(1)
    sources = {name: lambda: f"id{next(count)}" for name in ("session_id", "episode_id")}
    assert run_in_lobby(scenario, seed=lambda: 77, clock_ms=lambda: 5, **sources) == (
        "id1",
        "id2",
        77,
        5,
    )


def test_seeds_and_ids_are_unguessable_by_default():
    sources = Sources()
    assert len({sources.seed() for _ in range(100)}) == 100
    assert all(0 <= sources.seed() < 2**53 for _ in range(100))
    assert len(sources.session_id()) == 22
    assert len(sources.episode_id()) == 16
